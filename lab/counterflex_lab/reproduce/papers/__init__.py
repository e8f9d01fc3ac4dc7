"""Figures printed in the four papers beside ours: rows as data, functions that compute ours, tables, pages."""
