"""Load and motion of the robot's hand, where it holds the tool and where it holds the part.

The elastic chain ends in the hand. With the tool in it nothing is to be done. With the part in it, against a spindle
that stands, the part frame is the hand: with p the tool tip in the part and (t, theta) the small motion of the hand,
all in part axes, the tool moves relative to the part by ``-(t + theta x p)`` and turns by ``-theta``. Power gives the
load on the hand about its origin: ``-f`` and ``-(m + p x f)``. The way back has ``-p`` in place of p. See
:mod:`counterflex.plan.relative_motion`.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.primitives.loop_types import LOOP_TYPES

TO_HAND: Final = 1.0
"""Of a wrench: from the tool to the hand."""
TO_TOOL: Final = 1.0
"""Of a motion: from the hand to the tool."""
BACK: Final = -1.0
"""The other way, of both."""


@kernel("void(Settings, float64[::1], float64[::1])", **LOOP_TYPES)
def part_axes(settings: Record, nominal: Float, out: Float) -> None:
    """Rotation of the part in the base (9,) by rows: ``R_base_tcp R_part_tcp^T`` where the robot holds the part.

    ``nominal``: (12,) pose of the tool in the part, rotation by rows and position m.
    """
    R_base_tcp, R_base_part = settings.R_base_tcp[:], settings.R_base_part[:]
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = R_base_part[3 * i + j]
            if settings.holds_part == 1:
                a, b, c = R_base_tcp[3 * i], R_base_tcp[3 * i + 1], R_base_tcp[3 * i + 2]
                out[3 * i + j] = a * nominal[3 * j] + b * nominal[3 * j + 1] + c * nominal[3 * j + 2]


@kernel("void(Settings, float64[::1], float64[::1], int64, float64)", entry=True, **LOOP_TYPES)
def turned_load(settings: Record, nominal: Float, w: Float, at: int, way: float) -> None:
    """Wrench on the tool about its tip into that on the hand about its origin, or back: part axes, in place.

    Args:
        nominal: (12,) pose of the tool in the part.
        w: Array that holds the wrench (6) from ``at`` on.
        way: TO_HAND or BACK.
    """
    if settings.holds_part == 0:
        return
    x, y, z = way * nominal[9], way * nominal[10], way * nominal[11]
    a, b, c = w[at], w[at + 1], w[at + 2]
    w[at + 3] = -(w[at + 3] + y * c - z * b)
    w[at + 4] = -(w[at + 4] + z * a - x * c)
    w[at + 5] = -(w[at + 5] + x * b - y * a)
    w[at], w[at + 1], w[at + 2] = -a, -b, -c


@kernel("void(Settings, float64[::1], float64[::1], float64)", **LOOP_TYPES)
def turned_motion(settings: Record, nominal: Float, d: Float, way: float) -> None:
    """Small motion of the hand into that of the tool relative to the part, or back: part axes, in place.

    ``nominal``: (12,) pose of the tool in the part; ``d``: (6,) m and rad, changed; ``way``: TO_TOOL or BACK.
    """
    if settings.holds_part == 0:
        return
    x, y, z = way * nominal[9], way * nominal[10], way * nominal[11]
    a, b, c = d[3], d[4], d[5]
    d[0] = -(d[0] + b * z - c * y)
    d[1] = -(d[1] + c * x - a * z)
    d[2] = -(d[2] + a * y - b * x)
    d[3], d[4], d[5] = -a, -b, -c
