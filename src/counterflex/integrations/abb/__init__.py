"""ABB: RAPID, EGM."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"rapid": "counterflex.integrations.abb.language:LANGUAGE"},
    "counterflex.controller_data": {"abb": "counterflex.integrations.abb.controller_data:DATA"},
    "counterflex.robot_links": {"egm": "counterflex.integrations.abb.online:LINK"},
    "counterflex.robot_setups": {"egm": "counterflex.integrations.abb.link.setup:SETUP"},
    "counterflex.controllers": {"abb": "counterflex.integrations.abb.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
