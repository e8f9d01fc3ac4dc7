"""Which readings of a flange sensor are one measurement: those in the same orientation.

What the model of the sensor lacks (hose pack, cross-talk, the bent arm) is the same in every reading of one
orientation, however often it is read or copied. Weight, zero and centre of gravity show by the direction of gravity in
sensor axes alone, so readings whose directions of gravity are within :data:`ALIKE_RAD` of one that stands for them are
one group.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.units import DEG
from counterflex.identify.payload.residuals import SensorReadings

ALIKE_RAD: Final = 2.0 * DEG
"""Angle between directions of gravity in sensor axes up to which two readings are one orientation."""


def orientations(R_base_sensor: Float) -> Int:
    """Number of the orientation that each reading is one of, in the order in which they first come.

    ``R_base_sensor``: (n, 3, 3).

    Returns:
        (n,) ids from 0; a reading belongs to the first one within :data:`ALIKE_RAD`, not to a neighbour of a
        neighbour, so that a slow turn is not one orientation.
    """
    down, alike = R_base_sensor[:, 2, :], np.cos(ALIKE_RAD)
    out = np.full(len(down), -1, dtype=np.int64)
    count = 0
    for i in range(len(down)):
        if out[i] < 0:
            out[(out < 0) & (down @ down[i] >= alike)] = count
            out[i] = count
            count += 1
    return out


def groups_of(blocks: Sequence[SensorReadings], at_rest: Sequence[bool]) -> tuple[Int, ...]:
    """Groups of readings, within and between files: one for each orientation; groups of the files stay whole.

    ``at_rest``: Of each block, whether its rows are single orientations; motions keep groups of their own.

    Returns:
        (n,) ids for each block.
    """
    keys: list[Int] = []
    used = 0
    shared: dict[int, int] = {}
    for block, resting in zip(blocks, at_rest, strict=True):
        ids, place = np.unique(block.group, return_inverse=True)
        # Files of single readings share ids where they share a posture; those of a motion count its own windows.
        named = [shared.setdefault(int(i), used + k) if resting else used + k for k, i in enumerate(ids)]
        used += len(ids)
        keys.append(np.asarray(named, dtype=np.int64)[place.reshape(-1)])
    resting_blocks = [i for i, resting in enumerate(at_rest) if resting]
    if not resting_blocks:
        return tuple(keys)
    orientation = orientations(np.concatenate([blocks[i].R_base_sensor for i in resting_blocks])) + used
    group = np.concatenate([keys[i] for i in resting_blocks])
    size = int(orientation.max()) + 1
    links = scipy.sparse.coo_matrix((np.ones(len(group)), (group, orientation)), shape=(size, size))
    label = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    return tuple(np.asarray(label[key], dtype=np.int64) for key in keys)


def count_of(blocks: Sequence[SensorReadings]) -> int:
    """Number of different groups in all blocks."""
    return len(np.unique(np.concatenate([b.group for b in blocks])))
