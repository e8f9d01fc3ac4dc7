"""The page of inspected parts."""
