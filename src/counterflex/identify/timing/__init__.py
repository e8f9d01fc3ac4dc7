"""Recipe ``timing``: dead time, lag and clock of each channel of a record."""

TITLE = "dead time, lag and clock offset between channels, from a recorded motion"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
