"""Inverse kinematics on the calibrated elastic chain."""
