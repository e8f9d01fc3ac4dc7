"""How a cutter is to move so that there is little left to compensate: side, width, depth, chip, speed; trochoids."""
