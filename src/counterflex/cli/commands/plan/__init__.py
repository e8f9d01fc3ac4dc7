"""Commands of the group ``plan``: what to choose before a program is compensated."""
