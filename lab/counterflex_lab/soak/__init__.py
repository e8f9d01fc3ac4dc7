"""The online loop for hours against a simulated cell in real time."""
