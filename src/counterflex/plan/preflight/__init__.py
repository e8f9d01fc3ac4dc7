"""Checks of a program on a cell before it runs: reach, joints, cables, collisions, reversals, rapids, blocks."""
