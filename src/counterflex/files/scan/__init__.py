"""Measured points of a part, as scanners, coordinate measuring machines and probes write them."""
