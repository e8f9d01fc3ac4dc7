"""Reads cutter location files in APT (ISO 4343) and writes them back with only their targets replaced."""
