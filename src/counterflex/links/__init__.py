"""Sockets of the protocols and what real time needs of the operating system."""
