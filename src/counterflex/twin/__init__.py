"""The simulated robot cell: an elastic robot on an independent physics engine that really cuts the stock.

The twin is the truth that compensation is judged against. It shares geometry and catalogue data with the rest, never
the compliance, force or planning code.
"""
