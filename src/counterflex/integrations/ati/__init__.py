"""ATI: Net F/T."""

from typing import Final

ENTRY_POINTS: Final = {"counterflex.force_sensors": {"netft": "counterflex.integrations.ati.link.sensor:NETFT"}}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
