"""From sensor readings to the process wrench at the TCP and the process torque on the axes."""
