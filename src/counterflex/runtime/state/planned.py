"""A point of the planned path as the step reads it."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record

PLAN: Final = record(
    point=(float, 3),
    time=float,
    direction=(float, 3),
    wrench=(float, 6),
    cut=float,
    contained=(float, 6),
    play=(float, 3),
    ahead=(float, 6),
)
"""Part frame or part axes, SI; ``time`` planned (s).

``point``: as the program sends it. ``direction``: unit feed direction from here on, zero where nothing moves.
``wrench``: predicted, on the tool about the TCP. ``cut``: 1 where material is cut. ``contained``: correction that the
program contains already, m and rotation vector. ``play``: correction to be sent here so that play and friction are
undone in time. ``ahead``: wrench whose deflection is to be commanded here, so that it is undone in time.
"""
