"""KUKA: KRL, RSI."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"krl": "counterflex.programs.krl:LANGUAGE"},
    "counterflex.controller_data": {"kuka": "counterflex.app.controller_import.kuka_machine:DATA"},
    "counterflex.robot_setups": {"rsi": "counterflex.app.robot_setup.rsi:SETUP"},
    "counterflex.controllers": {"kuka": "counterflex.integrations.kuka.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
