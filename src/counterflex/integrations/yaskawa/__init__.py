"""Yaskawa: INFORM jobs of DX200 and YRC1000."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"inform": "counterflex.integrations.yaskawa.language:LANGUAGE"},
    "counterflex.controllers": {"yaskawa": "counterflex.integrations.yaskawa.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
