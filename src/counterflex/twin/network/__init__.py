"""Faults of the network between programs: losses, delays, copies, damage, scripted faults."""
