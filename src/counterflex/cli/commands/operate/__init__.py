"""Requests of an operator to a running loop, and its status line."""
