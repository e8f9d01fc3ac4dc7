"""RoboDK: tools and frames of a station, an app that hands one of its programs through counterflex."""

from typing import Final

ENTRY_POINTS: Final = {
    "counterflex.controller_data": {"robodk": "counterflex.integrations.robodk.station:DATA"},
    "counterflex.add_ins": {"robodk": "counterflex.integrations.robodk.add_in:ADD_IN"},
}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
