"""The simulated cell and single simulated devices on real sockets."""
