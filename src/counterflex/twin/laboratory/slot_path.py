"""The tool path of a program of straight test cuts, and what the machine was told along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.path.toolpath import FEED, RAPID, ToolPath

STEP_M = 0.25 * MM
_CLEAR_M = 15.0 * MM
COLUMNS = ("blank", "cut", "start_x_m", "start_y_m", "start_z_m", "end_x_m", "end_y_m", "end_z_m", "feed_m_s",
           "spindle_rad_s", "width_m")  # fmt: skip
"""Columns of a request: one straight feed motion a row; rows of one cut follow on one another."""


@dataclass(frozen=True, eq=False)
class StraightCuts:
    """Straight feed motions, one a row."""

    blank: Int  # (n,) number of the blank
    cut: Int  # (n,) number of the cut that the motion belongs to
    start_part: Float  # (n, 3) m, tool tip at its start, part frame
    end_part: Float  # (n, 3) m
    feed_m_s: Float  # (n,) along the motion
    spindle_rad_s: Float  # (n,) clockwise seen from the spindle
    width_m: Float  # (n,) signed width: positive from the left edge of the cutter, negative from the right

    def __len__(self) -> int:
        """Number of motions."""
        return len(self.cut)

    def subset(self, rows: Bool) -> StraightCuts:
        """The marked motions."""
        return StraightCuts(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @property
    def direction(self) -> Float:
        """(n, 3) unit vectors along the feed."""
        step = self.end_part - self.start_part
        out: Float = step / np.linalg.norm(step, axis=1, keepdims=True)
        return out


def straight_cuts(request: Mapping[str, Float]) -> StraightCuts:
    """The test cuts of a request's columns.

    Raises InputError: a column is missing, or a motion has no length or no speed.
    """
    missing = [name for name in COLUMNS if name not in request]
    if missing:
        raise InputError("the request for test cuts lacks a column", value=missing[0], limit=", ".join(COLUMNS))
    n = len(np.atleast_1d(request["cut"]))
    column = {name: as_float(name, np.atleast_1d(request[name]), (n,)) for name in COLUMNS}
    start, end = (np.stack([column[f"{end}_{c}_m"] for c in "xyz"], axis=1) for end in ("start", "end"))
    cuts = StraightCuts(
        blank=column["blank"].astype(np.int64),
        cut=column["cut"].astype(np.int64),
        start_part=start,
        end_part=end,
        feed_m_s=column["feed_m_s"],
        spindle_rad_s=column["spindle_rad_s"],
        width_m=column["width_m"],
    )
    length = np.linalg.norm(cuts.end_part - cuts.start_part, axis=1)
    if n == 0 or float(np.min(length)) < 1e-6 or float(np.min(cuts.feed_m_s)) <= 0.0:
        raise InputError("a test cut has no length or no feed", value=n)
    return cuts


def slot_path(cuts: StraightCuts, tool: int, rapid_m_s: float = 0.25) -> tuple[ToolPath, Int]:
    """Join the test cuts by rapids above the work.

    Returns the path, and (rows,) the test cut that each row runs, -1 between cuts.
    """
    top = float(max(cuts.start_part[:, 2].max(), cuts.end_part[:, 2].max())) + _CLEAR_M
    above = cuts.start_part[0].copy()
    above[2] = top
    along = [(above, -1)]
    for i in range(len(cuts)):
        if i == 0 or cuts.cut[i] != cuts.cut[i - 1]:
            for target in _over(along[-1][0], cuts.start_part[i], top):
                along.append((_between(along[-1][0], target, 1)[0], -1))
        begin, end = along[-1][0], cuts.end_part[i]
        count = max(1, int(np.ceil(np.linalg.norm(end - begin) / STEP_M)))
        along += [(point, i) for point in _between(begin, end, count)]
    last = along[-1][0].copy()
    last[2] = top
    along.append((_between(along[-1][0], last, 1)[0], -1))
    p, rows = np.array([point for point, _ in along]), np.array([row for _, row in along], dtype=np.int64)
    feeds = np.where(rows >= 0, cuts.feed_m_s[np.maximum(rows, 0)], rapid_m_s)
    length = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    motion = np.concatenate([[0], np.cumsum(np.diff(rows) != 0)]).astype(np.int64)
    spindle = np.where(rows >= 0, cuts.spindle_rad_s[np.maximum(rows, 0)], cuts.spindle_rad_s[0])
    path = ToolPath(
        p_part_tcp=p,
        axis_part=np.tile(np.array([0.0, 0.0, 1.0]), (len(p), 1)),
        kind=np.where(rows >= 0, FEED, RAPID).astype(np.int64),
        feed_m_s=feeds,
        spindle_rad_s=spindle,
        time_s=np.cumsum(length / feeds),
        motion=motion,
        tool=np.full(len(p), tool, dtype=np.int64),
    )
    return path, rows


def _between(begin: Float, end: Float, count: int) -> list[Float]:
    """The ``count`` points after ``begin`` in equal steps up to ``end``."""
    return [begin + (end - begin) * (k / count) for k in range(1, count + 1)]


def _over(here: Float, target: Float, top: float) -> Sequence[Float]:
    """Up, across and down to a point."""
    up, across = here.copy(), target.copy()
    up[2] = across[2] = top
    return (up, across, target)


def engaged(p_part: Float, low_part: Float, high_part: Float, radius_m: float) -> Bool:
    """Return whether the commanded tool touches the stated blank seen from above, (n,).

    ``p_part``: (n, 3) commanded tips, m. ``low_part``: (3,) lower corner of the blank. ``high_part``: (3,) upper
    corner.
    """
    nearest = np.clip(p_part[:, :2], low_part[:2], high_part[:2])
    inside = np.linalg.norm(p_part[:, :2] - nearest, axis=1) < radius_m
    return np.array(inside & (p_part[:, 2] < high_part[2]), dtype=np.bool_)
