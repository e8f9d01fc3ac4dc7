"""Siemens: Sinumerik."""

from typing import Final

ENTRY_POINTS: Final = {"counterflex.languages": {"sinumerik": "counterflex.integrations.siemens.language:LANGUAGE"}}
"""``module:object`` by group and name; a group is a kind of thing, as for packages of others."""
