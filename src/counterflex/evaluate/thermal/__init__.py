"""Thermal growth of spindle and arm as a slow state, from touches of one place between cuts."""
