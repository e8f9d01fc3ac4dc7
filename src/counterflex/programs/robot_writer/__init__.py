"""What the writers of robot programs share: points, parts, spindle and tool statements."""
