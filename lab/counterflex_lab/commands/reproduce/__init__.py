"""Commands of the group ``reproduce``: figures and experiments of published papers."""
