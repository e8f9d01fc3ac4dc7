"""Placement of the part in the cell: candidates judged on a thinned path, and the global search among them."""
