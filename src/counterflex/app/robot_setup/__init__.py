"""Files that a robot controller needs for online correction: checked, or made for a cell."""
