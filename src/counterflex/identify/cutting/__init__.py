"""Recipe ``cutting``: force constants of tool and material from test cuts."""

TITLE = "force constants of a material, from test slots"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
