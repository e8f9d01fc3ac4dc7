"""Error of the tool's path behind the deviations of a measured part, what of it repeats, and what explains it."""
