"""INFORM III jobs (JBI): read, executed, edited in place, written."""
