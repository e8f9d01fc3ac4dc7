"""KUKA: KRL, RSI."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"krl": "counterflex.integrations.kuka.language:LANGUAGE"},
    "counterflex.controller_data": {"kuka": "counterflex.integrations.kuka.machine_data:DATA"},
    "counterflex.robot_links": {"rsi": "counterflex.integrations.kuka.online:LINK"},
    "counterflex.robot_setups": {"rsi": "counterflex.integrations.kuka.link.setup:SETUP"},
    "counterflex.controllers": {"kuka": "counterflex.integrations.kuka.axes:AXES"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
