"""The generic wrench datagram: six components of any force sensor, in SI, over UDP."""
