"""Robust weighted least squares with priors: solve, standard deviations, hold-out, observability."""
