"""The online loop: one pure step from robot, force and tracker to a limited correction, and who lets it act."""
