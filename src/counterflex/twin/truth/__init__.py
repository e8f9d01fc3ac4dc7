"""What is true in the simulated cell, from a seed or a file."""
