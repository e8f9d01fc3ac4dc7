"""Programs that turn the tool axis: the machine they were written for, and poses of the tool from their words."""
