"""Figures printed in the papers beside ours: rows of a table, a verdict each."""
