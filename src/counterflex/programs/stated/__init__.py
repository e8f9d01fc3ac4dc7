"""Statements of a program beside its motions: offsets, units, tools, postures of the arm."""
