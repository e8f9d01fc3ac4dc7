"""FANUC: TP listings."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"fanuc": "counterflex.integrations.fanuc.language:LANGUAGE"},
    "counterflex.controllers": {"fanuc": "counterflex.integrations.fanuc.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
