"""The job ``log export --to``: a run for other viewers."""
