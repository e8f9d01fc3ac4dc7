"""Posture along a path: arm configuration and rotation about the tool axis, smallest deflection that matters."""
