"""The operator panel: a process beside the loop that shows what the loop does, and passes on what an operator asks."""
