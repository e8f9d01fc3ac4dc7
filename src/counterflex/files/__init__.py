"""Versioned files: cell, truth, plan, run records, summaries. Every key and column carries its unit."""
