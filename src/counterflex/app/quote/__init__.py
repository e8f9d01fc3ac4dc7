"""Probability that the features of a part keep their tolerances, before any cut."""
