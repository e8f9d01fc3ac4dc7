"""Recipe ``tracker-frame``: where the tracker stands and where its target sits."""

TITLE = "pose of the tracker in the base, of its target on the tool, drift, from fiducials or poses"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
