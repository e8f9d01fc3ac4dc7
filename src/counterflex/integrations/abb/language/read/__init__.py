"""Reading ABB RAPID: modules as CAM posts, RoboDK and RobotStudio write them."""
