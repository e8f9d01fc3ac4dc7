"""Common parts of the robot languages that are read and changed in place: programs, process words, circles, points."""
