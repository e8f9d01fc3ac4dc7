"""Common parts of the writers of robot programs: points, parts, spindle and tool statements."""
