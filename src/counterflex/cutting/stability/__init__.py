"""Stability of a milling cut against chatter: lobes, semi-discretisation, and the low-frequency criterion of robots."""
