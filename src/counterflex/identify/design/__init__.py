"""Which measurements to take: candidates, optimal choice, order, line of sight."""
