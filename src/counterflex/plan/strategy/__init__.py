"""Strategy of a cut that leaves little to compensate: side, width, depth, chip, speed; trochoids."""
