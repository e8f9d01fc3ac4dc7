"""The simulated cell cycle by cycle, and a recorded pass of it played again."""
