"""Design of measurements: candidates, optimal choice, order, line of sight."""
