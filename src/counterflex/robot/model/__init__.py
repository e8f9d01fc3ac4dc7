"""Descriptions of robots: segments, catalogue, DH, OPW, URDF, calibrated geometry."""
