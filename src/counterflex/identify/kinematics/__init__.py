"""Recipe ``kinematics``: geometric calibration of the arm."""

TITLE = "geometry of arm, base and tool, from tracker poses or points, distances, touched planes"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
