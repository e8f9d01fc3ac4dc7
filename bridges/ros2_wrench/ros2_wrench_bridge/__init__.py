"""Bridges between ROS 2 and counterflex: wrenches in, robot description in, corrections out."""
