"""Reading KUKA KRL: a ``.src`` file with the ``.dat`` file beside it, as CAM posts and RoboDK write them."""
