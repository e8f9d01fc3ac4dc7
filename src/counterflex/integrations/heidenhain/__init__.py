"""Heidenhain TNC 640: programs in Klartext."""
