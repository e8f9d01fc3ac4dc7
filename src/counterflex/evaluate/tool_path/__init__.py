"""The path that the tool ran, measured along it: laid on the program's path, smoothed, and the part it would leave."""
