"""What deflection, force and own errors are, from plan, force, tracker and motor currents."""
