"""Physics of the simulated cell: arm, drives, friction, chip, sensors."""
