"""Plain faults of measured data, found before anything is fitted: gaps, repeats that contradict, points on a line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int, rows_of_each
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.identify.data.channels import MEASURED_IN
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.residuals import Residuals

# Datasets that use the same rows of one file: which of them may, and the groups that they then share.
# One row of a laboratory's table often holds several measurements: a tracker pose and a ball bar's length, or what two
# trackers saw. Each is a dataset of its own with a manifest of its own. What must not happen is that one measurement
# counts twice, or that data predict themselves.

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
            # By columns (infinity norm): one axis that differs makes another posture, however well the other five
            # agree.
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

    ``datasets``: As :func:`counterflex.identify.data.data_checks.joined` gives them: kinds of single rows with joint
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


SAME_POSE_RAD: Final = 1e-5
"""Joint angles nearer than this are the same pose."""
CONTRADICTION: Final = 1e-6
"""Probability, all repeated poses taken together, below which repeats contradict each other."""
_ONE_PLACE_M: Final = 10.0 * MM  # Standard deviation along their longest direction below which points are in one place
THIN: Final = 1e-2
"""Spread across by spread along below which points are on a line (or in a plane)."""


def check_finite(data: Dataset, channels: Sequence[str]) -> None:
    """Refuse NaN and infinity. Raises InputError: names channel and line."""
    for name in channels:
        values = data.values(name).reshape(len(data), -1)
        bad = ~np.all(np.isfinite(values), axis=1)
        if np.any(bad):
            row = int(np.flatnonzero(bad)[0])
            raise InputError(
                f"channel '{name}' has {int(np.sum(bad))} rows that are not numbers",
                where=data.place(row),
                value=values[row].tolist(),
                hint="Remove the rows, or write drop_incomplete = true under [rows]",
            )


def check_moves(data: Dataset, channel: str, least: float) -> None:
    """Refuse a channel that stands still: a column that was copied down, or the wrong column.

    ``channel``: (n, k). ``least``: Spread (standard deviation of at least one component), SI, that any use has. Raises
    InputError: no component varies by that much.
    """
    spread = np.std(data.values(channel).reshape(len(data), -1), axis=0)
    if float(np.max(spread)) < least:
        raise InputError(
            f"channel '{channel}' hardly changes",
            where=data.where or data.name,
            value=f"{float(np.max(spread)):.3g} in the most lively component",
            limit=f">= {least:.3g} (standard deviation, SI)",
            hint=f"Check the columns and the unit under [channels.{channel}]",
        )


def same_poses(q: Float, tolerance: float = SAME_POSE_RAD) -> Int:
    """(n,) one id for all rows whose joint angles (n, 6) agree within a tolerance, numbered as they first come."""
    return leaders(q / tolerance)


def check_repeats(data: Dataset, channel: str, *, same: Sequence[str] = ("q",), gross: float = 100.0) -> None:
    """Refuse repeated poses whose values contradict each other, and data that are one pose throughout.

    Within each set of rows that are alike in the channels ``same``, the squares of the deviations from the mean over
    the stated variances are chi-square distributed; single gross errors (rows beyond ``gross`` standard deviations of
    the set's median) are left to the robust fit unless every second row of the set is one.

    ``channel``: (n, k) values that must agree. ``same``: Channels (n, k) that make rows alike. Raises InputError: names
    lines, difference and standard deviation.
    """
    key = np.hstack([data.values(name).reshape(len(data), -1) for name in same])
    ids = same_poses(key)
    if len(data) > 1 and np.all(ids == 0):
        raise InputError(
            "all rows are one and the same pose",
            where=data.where or data.name,
            value=f"{len(data)} rows",
            hint=f"Check the columns of {', '.join(same)}, or measure in different poses",
        )
    values = data.values(channel).reshape(len(data), -1)
    sigma = data.channel(channel).need_sigma()
    if sigma.shape != values.shape:
        return
    squares, numbers = 0.0, 0
    worst, lines = 0.0, ""
    for _, rows in rows_of_each(ids):
        rows, off = _without_gross(rows, values, sigma, gross)
        if len(rows) < 2:
            continue
        centred = (values[rows] - np.mean(values[rows], axis=0)) / sigma[rows]
        squares += float(np.sum(centred**2))
        numbers += (len(rows) - 1) * values.shape[1]
        if float(np.max(np.abs(off))) > worst:
            worst = float(np.max(np.abs(off)))
            k = int(np.argmax(np.max(np.abs(off), axis=0)))
            ends = rows[[int(np.argmin(values[rows, k])), int(np.argmax(values[rows, k]))]]
            lines = " and ".join(str(int(line)) for line in sorted({int(data.line[r]) for r in ends}))
    # Stated standard deviations are often optimistic by a factor of two or three; that is the fit's business.
    if numbers and scipy.stats.chi2.sf(squares / 25.0, numbers) < CONTRADICTION:
        raise InputError(
            f"repeated poses contradict each other in channel '{channel}'",
            where=f"{data.where or data.name}: lines {lines}",
            value=f"{worst:.3g} standard deviations apart, {np.sqrt(squares / numbers):.3g} in the mean of all repeats",
            limit="about 1",
            hint="The rows of two files may be out of step, the tracker may have moved, or sigma is far too small",
        )


def check_enough(parameters: Parameters, blocks: Sequence[Residuals]) -> None:
    """Refuse fewer measured numbers than parameters; rows of one group (repeats of a posture) count once.

    Raises InputError: says how many numbers there are and how many are needed.
    """
    free = {p.name for p in parameters if p.free}
    rows = sum(len(b.group) for b in blocks)
    groups = [len(np.unique(b.group)) for b in blocks]
    # Groups, not rows: copies of a posture add numbers but no equations.
    count = sum(n * len(b.components) for n, b in zip(groups, blocks, strict=True))
    if count < len(free) or count == 0:
        raise InputError(
            "there are too few measurements",
            value=f"{count} numbers in {sum(groups)} different postures ({rows} rows)",
            limit=f">= {max(len(free), 1)}, one for each number that is looked for, better twice as many",
            hint="Measure more poses (counterflex identify proposes them); repeats of a pose do not count",
        )


def check_spread(points: Float, what: str, *, where: str = "") -> None:
    """Refuse points that do not span what a frame needs.

    Args:
        points: (n, 3) m.
        what: For the message: ``fiducials``.

    Raises:
        InputError: Fewer than three, in one place or on one line.
    """
    if len(points) < 3:
        raise InputError(f"there are too few {what}", where=where or None, value=len(points), limit=">= 3")
    spread = np.linalg.svd(points - np.mean(points, axis=0), compute_uv=False) / np.sqrt(len(points))
    spread = np.pad(spread, (0, 3 - len(spread)))
    figures = " x ".join(f"{s / MM:.3g}" for s in spread) + " mm"
    if spread[0] < _ONE_PLACE_M:
        raise InputError(f"the {what} are all in one place", where=where or None, value=figures, limit="spread apart")
    if spread[1] < THIN * spread[0]:
        raise InputError(
            f"the {what} are on one line",
            where=where or None,
            value=f"spread {figures}",
            limit=f"second figure >= {THIN:g} of the first",
            hint="The rotation about that line is not determined; add a point well off it",
        )


def _without_gross(rows: Int, values: Float, sigma: Float, gross: float) -> tuple[Int, Float]:
    """A set of repeats without single gross errors, and deviations (n, k) from its median in standard deviations."""
    off = (values[rows] - np.median(values[rows], axis=0)) / sigma[rows]
    bad = np.max(np.abs(off), axis=1) > gross
    # Of two repeats nobody knows which is wrong; where half are off it is the data that contradict, not a row.
    single = len(rows) > 2 and np.sum(bad) < 0.5 * len(rows)
    return (rows[~bad], off[~bad]) if single else (rows, off)
