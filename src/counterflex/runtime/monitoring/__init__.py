"""Process monitoring and feed override: wear, breakage, chatter, speed of the program."""
