"""The device's side of every protocol: simulated controllers, sensors, trackers and a TwinCAT."""
