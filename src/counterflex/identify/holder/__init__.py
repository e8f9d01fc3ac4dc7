"""Recipe ``holder``: sensitivities of a strain-gauge spindle holder."""

TITLE = "force from strain gauges on the spindle holder, from known loads"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
