"""Cutting: the cutter, the material, removal of stock with engagement, and the forces of the process."""
