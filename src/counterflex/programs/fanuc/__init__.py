"""FANUC TP programs in their listing form, LS."""
