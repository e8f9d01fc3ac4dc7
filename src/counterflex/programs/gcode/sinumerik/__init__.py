"""Reads the Sinumerik dialect of G-code."""
