"""Figures of a played cell's times: cycles with correction, standstills of the machine, times to answer."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import UM
from counterflex.evaluate.loop_timing import Percentiles
from counterflex.runtime.state.supervisor import State
from counterflex_lab.soak.timed_block import NOT_REPORTED, Block

STOOD_S: Final = 1e-3
"""A cycle in which the simulated cell itself woke up later than this lies in a standstill of the machine."""


def in_standstill(block: Block) -> Bool:
    """(n,) cycles in which the machine stood still, or next to one: no program that has to do with the loop was slow.

    The simulated cell itself woke up more than :data:`STOOD_S` late, or the datagram that is only sent back was not.
    """
    stood: Bool = (block.woken_s > STOOD_S) | np.isnan(block.echo_s)
    around = stood.copy()
    around[1:] |= stood[:-1]
    around[:-1] |= stood[1:]
    return around


def active(block: Block) -> Bool:
    """(n,) cycles in which the loop corrected by its own word; one without an answer counts as the one before it."""
    states = block.reported_state.copy()
    known = np.flatnonzero(states != NOT_REPORTED)
    if len(known) == 0:
        return np.zeros(len(states), dtype=np.bool_)
    last = known[np.maximum(0, np.searchsorted(known, np.arange(len(states)), side="right") - 1)]
    active_rows: Bool = states[last] == State.ACTIVE
    return active_rows


def micro(time_s: Float) -> dict[str, float]:
    """Percentiles of times (:func:`counterflex.evaluate.loop_timing.percentiles`) in us; infinite where none came.

    Args:
        time_s: (n,) s; not-a-number counts as infinite.

    Returns:
        ``p50``, ``p99``, ``p999``, ``max``, and how many (``n``); not-a-number where there are none.
    """
    names = ("p50", "p99", "p999", "max")
    if len(time_s) == 0:
        return {**dict.fromkeys(names, math.nan), "n": 0}
    ranked = Percentiles.of(time_s)
    values = (ranked.p50_s, ranked.p99_s, ranked.p999_s, ranked.max_s)
    return {**{name: round(value / UM, 1) for name, value in zip(names, values, strict=True)}, "n": ranked.n}
