"""Slow reversals of single axes, which ``play`` and ``servo`` both read."""
