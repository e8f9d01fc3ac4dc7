"""Stock as lines of material along x, y and z: true walls, undercuts and tools that turn."""
