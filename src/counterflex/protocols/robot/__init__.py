"""Common parts of the links of all robot controllers: the UDP port, the session counter, the interface."""
