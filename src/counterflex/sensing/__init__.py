"""Measuring forces at the robot: the flange sensor and the strain-gauge spindle holder."""
