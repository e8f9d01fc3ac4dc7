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
    """Straight feed motions, one a row.

    Attributes:
        blank: (n,) number of the blank.
        cut: (n,) number of the cut that the motion belongs to.
        start_part: (n, 3) m, tool tip at its start, part frame.
        end_part: (n, 3) m.
        feed_m_s: (n,) along the motion.
        spindle_rad_s: (n,) clockwise seen from the spindle.
        width_m: (n,) signed width: positive from the left edge of the cutter, negative from the right.
    """

    blank: Int
    cut: Int
    start_part: Float
    end_part: Float
    feed_m_s: Float
    spindle_rad_s: Float
    width_m: Float

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

    Raises:
        InputError: A column is missing, or a motion has no length or no speed.
    """
    missing = [name for name in COLUMNS if name not in request]
    if missing:
        raise InputError("the request for test cuts lacks a column", value=missing[0], limit=", ".join(COLUMNS))
    n = len(np.atleast_1d(request["cut"]))
    column = {name: as_float(name, np.atleast_1d(request[name]), (n,)) for name in COLUMNS}

    def point(end: str) -> Float:
        return np.stack([column[f"{end}_{c}_m"] for c in "xyz"], axis=1)

    cuts = StraightCuts(
        blank=column["blank"].astype(np.int64),
        cut=column["cut"].astype(np.int64),
        start_part=point("start"),
        end_part=point("end"),
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

    Returns:
        The path, and (rows,) the test cut that each row runs, -1 between cuts.
    """
    top = float(max(cuts.start_part[:, 2].max(), cuts.end_part[:, 2].max())) + _CLEAR_M
    points: list[Float] = []
    kind: list[int] = []
    source: list[int] = []
    speed: list[float] = []

    def go(target: Float, what: int, feed: float, row: int) -> None:
        begin = points[-1]
        count = max(1, int(np.ceil(np.linalg.norm(target - begin) / STEP_M))) if what == FEED else 1
        for k in range(1, count + 1):
            points.append(begin + (target - begin) * (k / count))
            kind.append(what)
            source.append(row)
            speed.append(feed)

    above = cuts.start_part[0].copy()
    above[2] = top
    points.append(above)
    kind.append(RAPID)
    source.append(-1)
    speed.append(rapid_m_s)
    for i in range(len(cuts)):
        if i == 0 or cuts.cut[i] != cuts.cut[i - 1]:
            for target in _over(points[-1], cuts.start_part[i], top):
                go(target, RAPID, rapid_m_s, -1)
        go(cuts.end_part[i], FEED, float(cuts.feed_m_s[i]), i)
    last = points[-1].copy()
    last[2] = top
    go(last, RAPID, rapid_m_s, -1)
    p, rows = np.array(points), np.array(source, dtype=np.int64)
    feeds = np.array(speed)
    length = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    motion = np.concatenate([[0], np.cumsum(np.diff(rows) != 0)]).astype(np.int64)
    spindle = np.where(rows >= 0, cuts.spindle_rad_s[np.maximum(rows, 0)], cuts.spindle_rad_s[0])
    path = ToolPath(
        p_part_tcp=p,
        axis_part=np.tile(np.array([0.0, 0.0, 1.0]), (len(p), 1)),
        kind=np.array(kind, dtype=np.int64),
        feed_m_s=feeds,
        spindle_rad_s=spindle,
        time_s=np.cumsum(length / feeds),
        motion=motion,
        tool=np.full(len(p), tool, dtype=np.int64),
    )
    return path, rows


def _over(here: Float, target: Float, top: float) -> Sequence[Float]:
    """Up, across and down to a point."""
    up, across = here.copy(), target.copy()
    up[2] = across[2] = top
    return (up, across, target)


def engaged(p_part: Float, low_part: Float, high_part: Float, radius_m: float) -> Bool:
    """Whether the commanded tool touches the stated blank seen from above, (n,).

    Args:
        p_part: (n, 3) commanded tips, m.
        low_part: (3,) lower corner of the blank.
        high_part: (3,) upper corner.
        radius_m: Of the tool.
    """
    nearest = np.clip(p_part[:, :2], low_part[:2], high_part[:2])
    inside = np.linalg.norm(p_part[:, :2] - nearest, axis=1) < radius_m
    return np.array(inside & (p_part[:, 2] < high_part[2]), dtype=np.bool_)
