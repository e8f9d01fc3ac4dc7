"""Datasets that use the same rows of one file: which of them may, and the groups that they then share.

One row of a laboratory's table often holds several measurements: a tracker pose and a ball bar's length, or what two
trackers saw. Each is a dataset of its own with a manifest of its own. What must not happen is that one measurement
counts twice, or that data predict themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy

from counterflex.core.arrays import Int
from counterflex.core.errors import InputError
from counterflex.identify.data.channels import MEASURED_IN
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.same_postures import SINGLE_ROWS


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

    ``datasets``: As :func:`counterflex.identify.data.same_postures.joined` gives them: kinds of single rows with joint
    angles share group ids already.

    Returns:
        The same datasets in the same order; as they were where no two share a row.
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
