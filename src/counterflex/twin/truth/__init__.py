"""Truth of the simulated cell, from a seed or a file."""
