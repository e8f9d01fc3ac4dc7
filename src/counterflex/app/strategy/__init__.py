"""Strategy of an operation: what a program does now, what would leave less, and the program rewritten."""
