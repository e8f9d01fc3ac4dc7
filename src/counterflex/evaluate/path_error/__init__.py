"""Which error of the tool's path made the deviations of a measured part, what of it repeats, and what explains it."""
