"""What the languages of robots share that are read and changed in place: programs, process words, circles, points."""
