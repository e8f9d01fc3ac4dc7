"""Evaluate programs in the manner of Sinumerik: what the languages that derive from it share."""

from __future__ import annotations

from typing import Final

from counterflex.programs.limits import Limits

LIMITS: Final = Limits(
    line_characters=512,
    name_characters=24,
    points_per_file=10_000_000,
    position_decimals=4,
    angle_decimals=5,
    source="block length 512 characters, program names 24 (SINUMERIK 840D sl, Programming Manual Fundamentals)",
)
