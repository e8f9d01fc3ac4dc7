"""What the links of all robot controllers share: the UDP port, the session counter, the interface."""
