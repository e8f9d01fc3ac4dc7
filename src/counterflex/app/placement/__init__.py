"""Place of the part in the cell: the search through files, its regions and frames, maps, spindle mountings."""
