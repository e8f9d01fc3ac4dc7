"""Recipe ``payload``: zero, weight, centre of gravity, mounting and hose pack of the flange sensor."""

TITLE = "bias, weight, centre of gravity, hose pack at the force sensor, from many orientations"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
