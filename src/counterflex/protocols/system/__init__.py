"""The operating system: sockets without allocation, real-time priority, time-keeping of the machine."""
