"""What goes wrong between programs: losses, delays, copies, damage, scripted faults."""
