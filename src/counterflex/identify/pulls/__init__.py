"""Displacement of the tool under known loads, which ``stiffness`` and ``cubes`` both fit."""
