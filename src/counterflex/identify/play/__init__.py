"""Recipe ``play``: dead band and dry friction of the axes from slow reversals."""

TITLE = "lost motion and friction of the axes, from slow reversals"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
