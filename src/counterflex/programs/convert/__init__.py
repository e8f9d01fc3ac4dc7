"""A program of one language said in another: the same motions, speeds and process words."""
