"""How far a frame of a program may be from that of the cell."""

from __future__ import annotations

from typing import Final

from counterflex.core.units import DEG, MM

SAME_M: Final = 0.01 * MM
"""Frames whose origins are closer are the same: posts write three decimals."""
SAME_RAD: Final = 0.005 * DEG
