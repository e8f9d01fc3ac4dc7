"""Rows measured in one and the same posture belong together: a fit that has seen one of them has seen all.

A pose that was recorded twice, or copied, predicts itself: with rows dealt singly the error on data not used would be
that of the instrument. Rows are joined where all axes agree within :data:`ALIKE_RAD` with a row that stands for the
others (not from neighbour to neighbour, so that a slow path is not one group), and, where a load is part of the row,
where the loads agree as well. Groups that the manifest names stay whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG
from counterflex.identify.data.dataset import Dataset

ALIKE_RAD: Final = 0.1 * DEG
"""Largest difference of an axis between rows of one posture."""
ALIKE_LOAD: Final = 0.05
"""Largest difference of a load between rows of one measurement, of the largest load of the dataset."""
SINGLE_ROWS: Final = frozenset({"tracker_poses", "tracker_points", "distances", "planes", "pulls", "sensor_poses"})
"""Kinds of datasets whose rows are measurements of their own."""
_LOADS: Final = {"pulls": "w_tcp_base"}


def joined(datasets: Sequence[Dataset]) -> tuple[Dataset, ...]:
    """Datasets with groups that rows of one posture share, within a file and between files.

    ``datasets``: As read. Kinds whose rows follow each other in time, and rows without joint angles, keep their groups.
    """
    chosen = [i for i, d in enumerate(datasets) if d.kind in SINGLE_ROWS and d.has("q") and len(d)]
    if not chosen:
        return tuple(datasets)
    keys: list[Int] = []
    first = 0
    for i in chosen:
        _, own = np.unique(datasets[i].group, return_inverse=True)
        keys.append(np.asarray(own, dtype=np.int64) + first)
        first += int(own.max()) + 1
    postures = [np.zeros(0, dtype=np.int64)] * len(chosen)
    for width in sorted({datasets[i].values("q").shape[1] for i in chosen}):
        members = [k for k, i in enumerate(chosen) if datasets[i].values("q").shape[1] == width]
        posture_ids = leaders(np.concatenate([_feature(datasets[chosen[k]]) for k in members]))
        ends = np.cumsum([len(datasets[chosen[k]]) for k in members])
        for k, part in zip(members, np.split(posture_ids, ends[:-1]), strict=True):
            postures[k] = part + first
        first += int(posture_ids.max()) + 1
    group, posture = np.concatenate(keys), np.concatenate(postures)
    links = scipy.sparse.coo_matrix((np.ones(len(group)), (group, posture)), shape=(first, first))
    label = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    out = list(datasets)
    for k, i in enumerate(chosen):
        out[i] = replace(datasets[i], group=np.asarray(label[keys[k]], dtype=np.int64))
    return tuple(out)


def _feature(d: Dataset) -> Float:
    """Rows in units in which 1 is alike."""
    parts = [d.values("q") / ALIKE_RAD, np.zeros((len(d), 6))]
    load = _LOADS.get(d.kind)
    if load is not None and d.has(load):
        w = d.values(load)
        size = np.maximum(np.nanmax(np.abs(w), initial=0.0, axis=0), 1e-12)
        parts[1][:, : w.shape[1]] = w / (ALIKE_LOAD * size)
    feature: Float = np.concatenate(parts, axis=1)
    return feature


def leaders(rows: Float) -> Int:
    """Number of the row that stands for each row: the first within 1 in every column, in the order of the rows.

    ``rows``: (n, k); rows that are not finite stand for themselves.

    Returns:
        (n,) ids from 0.
    """
    n = len(rows)
    out = np.full(n, -1, dtype=np.int64)
    finite: Bool = np.all(np.isfinite(rows), axis=1)
    places = np.flatnonzero(finite)
    tree = scipy.spatial.cKDTree(rows[places]) if len(places) else None
    count = 0
    for i in range(n):
        if out[i] >= 0:
            continue
        out[i] = count
        if tree is not None and finite[i]:
            near = places[tree.query_ball_point(rows[i], 1.0 + 1e-9, p=np.inf)]
            out[near[out[near] < 0]] = count
        count += 1
    return out


def regions(q: Float, group: Int, count: int, seed: int = 0) -> Int:
    """Divide measurements into regions of the joint space, so that a whole region can be held out.

    Args:
        q: (n, k) rad.
        group: (n,) rows of a group stay together.
        count: Regions wanted; fewer where there are fewer groups.
        seed: Of the first centres.

    Returns:
        (n,) region 0 .. of each row, by k-means of the groups' mean angles.
    """
    ids, place = np.unique(group, return_inverse=True)
    total = np.zeros((len(ids), q.shape[1]))
    np.add.at(total, place, q)
    mean = total / np.bincount(place)[:, None]
    rng = np.random.default_rng(seed)
    count = min(count, len(ids))
    centre = mean[[int(rng.integers(len(ids)))]]
    while len(centre) < count:  # the farthest from all centres is the next one
        far = np.min(np.linalg.norm(mean[:, None] - centre[None], axis=2), axis=1)
        centre = np.vstack([centre, mean[[int(np.argmax(far))]]])
    for _ in range(50):
        nearest = np.argmin(np.linalg.norm(mean[:, None] - centre[None], axis=2), axis=1)
        moved = np.array([mean[nearest == k].mean(axis=0) if np.any(nearest == k) else centre[k] for k in range(count)])
        if np.allclose(moved, centre):
            break
        centre = moved
    _, compact = np.unique(nearest, return_inverse=True)
    out: Int = np.asarray(compact, dtype=np.int64)[place]
    return out
