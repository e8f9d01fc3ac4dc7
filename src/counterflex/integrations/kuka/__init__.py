"""KUKA: KRL, RSI."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"krl": "counterflex.programs.krl:LANGUAGE"},
    "counterflex.controllers": {"kuka": "counterflex.integrations.kuka.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
