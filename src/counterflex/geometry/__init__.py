"""Rotations, poses, wrenches and rigid registration; arrays in, arrays out, single or batched."""

from counterflex.geometry import pose, rotation

__all__ = ["pose", "registration", "rotation", "wrench"]
