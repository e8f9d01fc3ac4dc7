"""Beckhoff: TwinCAT NC I."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"twincat": "counterflex.programs.gcode.twincat:LANGUAGE"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
