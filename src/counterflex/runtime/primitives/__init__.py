"""Common parts of several stages of the step: frames, place on the path, history, filters."""
