"""The online step and its stages."""
