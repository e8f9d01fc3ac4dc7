"""What several stages of the step share: frames, place on the path, history, filters."""
