"""Features of any program, found on the surface that it makes: pockets, islands, steps, walls, free form."""
