"""WrenchStamped of ROS 2 as generic wrench datagrams."""
