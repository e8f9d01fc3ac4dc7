"""Recipe ``stiffness``: compliance of every elastic element from pulls at the tool."""

TITLE = "compliances of joints, links, bodies, from displacement of the tool under known loads"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
