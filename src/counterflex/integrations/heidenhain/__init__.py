"""Heidenhain: Klartext of the TNC 640."""

from typing import Final

ENTRY_POINTS: Final = {"counterflex.languages": {"heidenhain": "counterflex.integrations.heidenhain.language:LANGUAGE"}}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
