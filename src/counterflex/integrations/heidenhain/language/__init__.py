"""Read Klartext, evaluate it, edit it in place and write it."""
