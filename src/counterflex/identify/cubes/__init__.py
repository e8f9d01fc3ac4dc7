"""Recipe ``cubes``: compliance of every elastic element from measuring cubes on the structure."""

TITLE = "compliances of single elements, from motion of measuring cubes on the structure"
"""What the recipe identifies, and from what: in the help, in result.json, over the report, in docs/identify.md."""
