"""Recipe ``cubes``: compliance of every elastic element from measuring cubes on the structure."""
