"""Machine a program on the simulated cell, judge the part, and put both into a report."""
