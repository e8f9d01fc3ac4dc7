"""Datasets that use the same rows of one file: which of them may, and the groups that they then share.

One row of a laboratory's table often holds several measurements: a tracker pose and a ball bar's length, or what two
trackers saw. Each is a dataset of its own with a manifest of its own. What must not happen is that one measurement
counts twice, or that data predict themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.identify.data.channels import MEASURED_IN
from counterflex.identify.data.dataset import Dataset

# Rows measured in one and the same posture belong together: a fit that has seen one of them has seen all.
# A pose that was recorded twice, or copied, predicts itself: with rows dealt singly the error on data not used would be
# that of the instrument. Rows are joined where all axes agree within :data:`ALIKE_RAD` with a row that stands for the
# others (not from neighbour to neighbour, so that a slow path is not one group), and, where a load is part of the row,
# where the loads agree as well. Groups that the manifest names stay whole.

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

    ``rows``: (n, k); rows that are not finite stand for themselves. Returns (n,) ids from 0.
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

    ``q``: (n, k) rad. ``group``: (n,) rows of a group stay together. ``count``: Regions wanted; fewer where there are
    fewer groups. Returns (n,) region 0 .. of each row, by k-means of the groups' mean angles.
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


def require_disjoint(data: Sequence[Dataset], holdout: Sequence[Dataset]) -> None:
    """No measurement is used twice: it would be counted twice, or predicted from itself.

    Args:
        data: Datasets that parameters are fitted to. Two of them may hold the same rows of a file where what they
            measured stands in different columns.
        holdout: Datasets that are only predicted; they may share no row with data, whatever the columns, since all
            measurements of a row share its posture and its load. Among themselves as data.

    Raises:
        InputError: A measurement is used twice; names the row and the columns.
    """
    every = [*data, *holdout]
    for j, one in enumerate(every):
        for i, other in enumerate(every[:j]):
            both = _lines_of_both(one, other)
            if len(both) == 0:
                continue
            where, value = f"{one.file}:{int(both[0])}", f"{other.where} and {one.where}"
            if i < len(data) <= j:
                raise InputError(
                    "two datasets hold the same rows of a file, one as data and one as hold-out",
                    where=where,
                    value=value,
                    hint="Divide the file by [rows] first_line, last_line",
                )
            columns = _counted_twice(one, other)
            if columns:
                raise InputError(
                    f"two datasets hold the same rows of a file and the same measurement ({', '.join(columns)})",
                    where=where,
                    value=value,
                    hint="Divide the file by [rows] first_line, last_line, or give it once; only other columns may "
                    "use the same rows",
                )


def joined_by_rows(datasets: Sequence[Dataset]) -> tuple[Dataset, ...]:
    """Datasets with groups that all measurements of one row of a file share, so that folds hold them out together.

    ``datasets``: As :func:`counterflex.identify.data.shared_rows.joined` gives them: kinds of single rows with joint
    angles share group ids already. Returns the same datasets in the same order; as they were where no two share a row.
    """
    if not any(len(_lines_of_both(one, other)) for j, one in enumerate(datasets) for other in datasets[:j]):
        return tuple(datasets)
    ids: dict[tuple[object, ...], int] = {}
    groups, rows, keys = [], [], []
    for i, d in enumerate(datasets):
        space = -1 if d.kind in SINGLE_ROWS and d.has("q") else i
        groups.append(np.array([ids.setdefault((space, int(g)), len(ids)) for g in d.group], dtype=np.int64))
        for line, group in zip(d.line if d.file else (), groups[-1], strict=False):
            rows.append(int(group))
            keys.append((_file(d), int(line)))
    place: dict[tuple[str, int], int] = {}
    line_of = np.array([place.setdefault(key, len(place)) for key in keys], dtype=np.int64)
    size = len(ids) + len(place)
    links = scipy.sparse.coo_matrix((np.ones(len(rows)), (np.array(rows), line_of + len(ids))), shape=(size, size))
    label = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    return tuple(replace(d, group=np.asarray(label[g], dtype=np.int64)) for d, g in zip(datasets, groups, strict=True))


def _file(dataset: Dataset) -> str:
    return str(Path(dataset.file).resolve())


def _lines_of_both(one: Dataset, other: Dataset) -> Int:
    if not one.file or not other.file or _file(one) != _file(other):
        return np.zeros(0, dtype=np.int64)
    both: Int = np.intersect1d(one.line, other.line)
    return both


def _counted_twice(one: Dataset, other: Dataset) -> list[str]:
    """Columns of measurements that both use; where it is open what was measured, those of the one that adds nothing."""
    mine, theirs = (_columns(d, MEASURED_IN.get(d.kind, ())) for d in (one, other))
    if mine and theirs:
        return sorted(mine & theirs)
    mine, theirs = (_columns(d, (name for name in d.channels if not name.startswith("time_"))) for d in (one, other))
    return sorted(mine & theirs) if mine <= theirs or theirs <= mine else []


def _columns(dataset: Dataset, names: Iterable[str]) -> set[str]:
    shared = set(names) & set(dataset.channels)
    return {column for name in shared for column in dataset.channels[name].columns}
