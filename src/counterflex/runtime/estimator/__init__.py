"""Estimates of deflection, force and own errors, from plan, force, tracker and motor currents."""
