"""Recipe ``timing``: dead time, lag and clock of each channel of a record."""
