"""Shared by the processes of a run: numbers in memory, signs of life, locks, requests of the operator."""
