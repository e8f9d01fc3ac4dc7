"""Writes the same G-code back with only the targets changed."""
