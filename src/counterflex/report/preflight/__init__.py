"""The page of a preflight: checks, joint margins, and what the robot does along the path."""
