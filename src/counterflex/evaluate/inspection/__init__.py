"""A real part judged: its scan placed on the nominal part by datum faces, and how far its surface is off."""
