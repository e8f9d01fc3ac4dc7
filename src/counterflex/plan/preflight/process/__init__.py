"""Checks of a program that stand on what it states and on its predicted cut."""
