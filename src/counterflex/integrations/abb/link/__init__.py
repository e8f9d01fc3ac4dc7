"""ABB EGM: the set-up of the controller, checked and made."""
