"""Performance figures of ISO 9283:1998 from measured poses and paths, each with its confidence interval."""
