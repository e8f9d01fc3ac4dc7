"""Compiled kernels of the elastic chain: single points, batches, lanes, the online step."""
