"""The elastic robot: description, catalogue, kinematics, compliance, gravity."""
