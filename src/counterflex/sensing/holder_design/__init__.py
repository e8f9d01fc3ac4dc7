"""Design of a force-sensing spindle holder: pockets and ribs in its cheeks, by finite elements."""
