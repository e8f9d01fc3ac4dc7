"""Recipe ``stiffness``: compliance of every elastic element from pulls at the tool."""
