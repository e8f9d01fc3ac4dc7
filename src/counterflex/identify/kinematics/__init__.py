"""Recipe ``kinematics``: geometric calibration of the arm."""
