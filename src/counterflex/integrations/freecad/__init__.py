"""FreeCAD: a job of its CAM workbench goes through counterflex."""

from typing import Final

ENTRY_POINTS: Final = {"counterflex.add_ins": {"freecad": "counterflex.integrations.freecad.add_in:ADD_IN"}}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
