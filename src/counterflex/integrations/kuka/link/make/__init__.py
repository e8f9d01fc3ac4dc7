"""Writes the files of an RSI set-up for each generation of the controller."""
