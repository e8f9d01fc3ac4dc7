"""Staubli VAL3: programs (.pgx) with the data file (.dtx) of their application."""
