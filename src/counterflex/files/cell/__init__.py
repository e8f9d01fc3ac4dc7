"""The cell file: one module per table, and what reads, checks and updates the whole."""
