"""Beckhoff: TwinCAT NC I, ADS."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.languages": {"twincat": "counterflex.integrations.beckhoff.language:LANGUAGE"},
    "counterflex.plcs": {"ads": "counterflex.integrations.beckhoff.jobs:PLC"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
