"""Reading VAL3 programs as CAM posts and Staubli Robotics Suite write them."""
