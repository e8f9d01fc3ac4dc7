"""Gains and filters of the loop, worked out before it runs."""
