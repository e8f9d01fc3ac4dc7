"""Faults composed at random: the whole online system on a virtual clock, invariants looked at in every cycle."""
