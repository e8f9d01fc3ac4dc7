"""G-code (RS274/NGC): reading it, and writing it back with other targets."""
