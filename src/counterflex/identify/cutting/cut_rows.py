"""Rows of a record of test cuts: which belong to one cut, which are air."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.data.dataset import Dataset


@dataclass(frozen=True, eq=False)
class Pieces:
    """Mean forces of steady pieces of cuts, in the feed frame."""

    force: Float  # (n, 3) N on the tool: along the feed, to its left, up
    sigma: Float  # (n, 3) N standard deviation of these means
    depth_m: Float  # (n,) axial depth: measured where `measured`, else commanded
    depth_sigma_m: Float  # (n,) its standard deviation where measured, else 0
    measured: Bool  # (n,) whether the depth was measured
    left_m: Float  # (n,) left bound of the engaged strip from the tool axis, commanded, R at the cutter's edge
    right_m: Float  # (n,) right bound, -R at the cutter's edge
    left_wall: Bool  # (n,) whether the left bound is the work's edge (down-milling), which does not move with the tool
    right_wall: Bool  # (n,) whether the right bound is (up-milling)
    feed_tooth_m: Float  # (n,) horizontal feed per tooth
    drop_tooth_m: Float  # (n,) descent per tooth; of the measured floor where the depth was measured
    drop_sigma_m: Float  # (n,) its standard deviation
    give_m: Float  # (n, 3) displacement of the tool under the measured force by the elastic model; 0 where unknown
    elastic: Bool  # (n,) whether it is known
    axes: Float  # (n, 3, 3) from the axes that the force was given in to the feed frame
    # (n,) amplitude of the force across the tool axis once per turn, NaN where the record does not show it
    turn_n: Float
    cut: Int  # (n,) id of the cut, over all datasets
    blank: Int  # (n,) index of the blank
    run_m: Float  # (n,) length that the tool had cut before
    session: Int  # (n,) index of the dataset
    place: Int  # (n,) index into the places of steady_cuts.pieces_of, for messages

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self.cut)

    def subset(self, rows: Bool) -> Pieces:
        """The marked pieces."""
        return Pieces(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


FORCES: Final = ("w_tcp_base", "f_tcp_base", "f_tcp_part")
"""Channels that hold the force, the first that is there is used."""
AIR: Final = "air"
NO_AIR: Final = "none"
"""Value of the manifest's setting ``air``: no row of the record is in air."""


def force_of(dataset: Dataset) -> str:
    """Name of the channel that holds the force."""
    return next((name for name in FORCES if dataset.has(name)), FORCES[0])


def has_air(dataset: Dataset) -> bool:
    """Return whether rows in air are to be looked for.

    Raises InputError: the setting ``air`` has another value than ``none``.
    """
    stated = str(dataset.settings.get(AIR, ""))
    if stated not in ("", NO_AIR):
        raise InputError("unknown setting", where=f"{dataset.where}: {AIR}", value=stated, limit=f"'{NO_AIR}'")
    return not stated


def in_air(dataset: Dataset) -> bool:
    """Return whether a whole record was taken in air: it shows the zero of the force for the other files."""
    return dataset.has("time_s") and len(dataset) > 0 and not np.any(dataset.values("depth") > 0.0)


def zero_in_air(data: Sequence[Dataset]) -> tuple[Float, Float] | None:
    """Zero of the force (k,) and its standard deviation (k,) by records taken in air; None without any.

    Of several records, the median of each counts once, and half of the range of these is part of the standard
    deviation: the zero drifts from one to the next.
    """
    records = [d for d in data if in_air(d)]
    if not records:
        return None
    middle = np.array([np.median(d.values(force_of(d)), axis=0) for d in records])
    error = np.array(
        [
            1.2533 * 1.4826 * np.median(np.abs(d.values(force_of(d)) - m), axis=0) / np.sqrt(len(d))
            for d, m in zip(records, middle, strict=True)
        ]
    )
    sigma: Float = np.hypot(np.sqrt(np.mean(error**2, axis=0)), 0.5 * np.ptp(middle, axis=0))
    return middle.mean(axis=0), sigma


def ungrouped(dataset: Dataset) -> bool:
    """Return whether every row is a group of its own: the manifest names no column that says which rows are one cut."""
    return len(np.unique(dataset.group)) == len(dataset)


def cuts_of(dataset: Dataset) -> Iterator[tuple[int, Int]]:
    """Number and rows, in order of time, of each cut of a record; without groups it is one."""
    time = dataset.values("time_s")[:, 0]
    whole = ungrouped(dataset)
    for cut in [0] if whole else dict.fromkeys(dataset.group.tolist()):
        rows = np.arange(len(dataset)) if whole else np.flatnonzero(dataset.group == cut)
        yield int(cut), rows[np.argsort(time[rows], kind="stable")].astype(np.int64)


def rows_per_turn(time_s: Float, spindle_rad_s: Float) -> int:
    """Rows in a revolution of the spindle."""
    if len(time_s) < 2:
        return 1
    period = float(np.median(np.diff(time_s)))
    speed = float(np.median(spindle_rad_s))
    return max(1, round(2.0 * np.pi / (speed * period))) if period > 0.0 and speed > 0.0 else 1


def tools_of(dataset: Dataset) -> Int:
    """(rows,) number of the tool."""
    if dataset.has("tool"):
        return np.array(np.round(dataset.values("tool")[:, 0]), dtype=np.int64)
    return np.full(len(dataset), int(dataset.settings.get("tool", 1)), dtype=np.int64)


def chosen_tool(data: Sequence[Dataset], requested: int | None) -> int:
    """The one tool of the test cuts.

    Args:
        data: Datasets of kind ``slots``.
        requested: Its number; None where there is one.

    Raises:
        InputError: None of this number, or several.
    """
    numbers = np.unique(np.concatenate([tools_of(d) for d in data])) if data else np.zeros(0, dtype=np.int64)
    if requested is not None:
        if requested not in numbers:
            raise InputError("no test cut was made with this tool", value=f"T{requested}", limit=_names(numbers))
        return requested
    if len(numbers) != 1:
        raise InputError(
            "the test cuts were made with several tools; the constants belong to one tool and material",
            value=_names(numbers),
            hint="Choose one: --set tool=1",
        )
    return int(numbers[0])


def _names(numbers: Int) -> str:
    return ", ".join(f"T{i}" for i in numbers) or "none"
