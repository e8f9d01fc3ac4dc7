"""ABB: RAPID, EGM."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"rapid": "counterflex.programs.rapid:LANGUAGE"},
    "counterflex.controller_data": {"abb": "counterflex.app.controller_import.abb:DATA"},
    "counterflex.robot_setups": {"egm": "counterflex.app.robot_setup.egm:SETUP"},
    "counterflex.controllers": {"abb": "counterflex.integrations.abb.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
