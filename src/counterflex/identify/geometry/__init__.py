"""Geometry of arm, tracker and target as parameters of an identification."""
