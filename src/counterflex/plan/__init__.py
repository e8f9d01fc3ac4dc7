"""Planning: posture along the path, predicted cut and deflection, the compensated path."""
