"""One module per group of commands; each parses, calls one job and prints."""
