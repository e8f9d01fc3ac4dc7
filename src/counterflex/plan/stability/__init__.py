"""Stability along a path: the margin of every stretch against chatter of the robot and of spindle and tool."""
