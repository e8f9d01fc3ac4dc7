"""Staubli: VAL3."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"val3": "counterflex.integrations.staubli.language:LANGUAGE"},
    "counterflex.controllers": {"staubli": "counterflex.integrations.staubli.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
