"""Recipe ``play``: dead band and dry friction of the axes from slow reversals."""
