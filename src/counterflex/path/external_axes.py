"""External axes along a program: a rail under the robot, a positioner under the part, one place for each operation.

An operation is cut while all external axes stand. Between two operations they go from one place to the next, in step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import RAPID, ToolPath

STEP_M: Final = 5.0 * MM
STEP_RAD: Final = 0.25 * DEG
"""Largest step of an external axis from row to row of a path."""


@dataclass(frozen=True, eq=False)
class ExternalAxis:
    """One axis."""

    number: int  # 1 to 6, of E1 to E6
    turning: bool  # it turns; else it goes straight
    carries_robot: bool  # it carries the robot; else the part
    direction: Float  # (3,) unit vector
    origin: Float  # (3,) m, a point of the axis of one that turns
    low: float  # lower limit, m or rad
    high: float  # upper limit

    @property
    def unit(self) -> float:
        """SI value of the unit that programs and the cell file state it in."""
        return DEG if self.turning else MM

    @property
    def word(self) -> str:
        """Name of that unit."""
        return "deg" if self.turning else "mm"

    def matrices(self, values: Float) -> Float:
        """(n, 4, 4) by which the axis at values (n,) has moved what it carries from where that is at zero."""
        turns = np.asarray(values, dtype=np.float64)[:, None] * self.direction
        if not self.turning:
            return pose.make(np.broadcast_to(np.eye(3), (len(turns), 3, 3)), turns)
        R = rotation.exp(turns)
        return pose.make(R, self.origin - R @ self.origin)


@dataclass(frozen=True, eq=False)
class ExternalPlaces:
    """Places of the external axes in the order in which a program takes them."""

    axes: tuple[ExternalAxis, ...]  # the axes; the first of those that carry the same carries the next
    values: Float  # (places, axes) m or rad
    T_zero_part: Float  # (4, 4) m, the part in the robot base with all axes at zero

    def values_at(self, place: Float) -> Float:
        """(n, axes) values at numbers of places (n,); between two places linear."""
        number = np.arange(len(self.values))
        return np.stack([np.interp(place, number, column) for column in self.values.T], axis=1)

    def shown(self, place: int) -> dict[int, float]:
        """Values at a place by the number of the axis, mm or deg."""
        return {axis.number: float(v / axis.unit) for axis, v in zip(self.axes, self.values[place], strict=True)}

    def Ts_base_floor(self, place: Float) -> Float:
        """(n, 4, 4) m, the robot base at zero of its axes, in the robot base where it stands."""
        return pose.inverse(self._moved(self.values_at(place), carries_robot=True))

    def Ts_base_part(self, place: Float) -> Float:
        """(n, 4, 4) m, the part in the robot base."""
        moved = self._moved(self.values_at(place), carries_robot=False)
        out: Float = self.Ts_base_floor(place) @ moved @ self.T_zero_part
        return out

    def _moved(self, values: Float, *, carries_robot: bool) -> Float:
        out = np.broadcast_to(np.eye(4), (len(values), 4, 4))
        for axis, column in zip(self.axes, values.T, strict=True):
            if axis.carries_robot == carries_robot:
                out = out @ axis.matrices(column)
        return out

    def beyond(self) -> tuple[int, int] | None:
        """Place and index of an axis that cannot stand there; None where all can."""
        low, high = (np.array([getattr(axis, side) for axis in self.axes]) for side in ("low", "high"))
        out = np.argwhere((self.values < low - 1e-9) | (self.values > high + 1e-9))
        return None if len(out) == 0 else (int(out[0, 0]), int(out[0, 1]))


@dataclass(frozen=True)
class AxisChange:
    """External axes go to another place."""

    motion: int  # of the program
    standing: bool  # the tool stands in the part at the end of the motion meanwhile; else they move along with it
    values: Mapping[int, float]  # value by number of the axis, mm or deg: of those that move


def places_of(
    axes: tuple[ExternalAxis, ...], at: Mapping[int, float], changes: Sequence[AxisChange], T_zero_part: Float
) -> ExternalPlaces:
    """Places that changes lead to.

    Args:
        at: Value at the begin of the program by number, mm or deg.
        changes: In their order.
        T_zero_part: See :class:`ExternalPlaces`.
    """
    rows, now = [], dict(at)
    for values in ({}, *(change.values for change in changes)):
        now |= values
        rows.append([now[axis.number] * axis.unit for axis in axes])
    return ExternalPlaces(axes, np.array(rows).reshape(len(changes) + 1, len(axes)), T_zero_part)


def with_places(path: ToolPath, changes: Sequence[AxisChange], places: ExternalPlaces, speed_m_s: float) -> ToolPath:
    """A sampled path with the places of the external axes, and rows in which they move.

    Args:
        path: n rows.
        changes: In the order of their motions.
        places: One more than there are changes.
        speed_m_s: Speed that is taken for them, of the tool centre point where they turn: no program states it.
    """
    for number, change in enumerate(changes):
        rows = np.flatnonzero(path.motion == change.motion)
        if len(rows) == 0:
            continue
        steps, time_s = _steps(places, number, speed_m_s)
        first, last = int(rows[0]), int(rows[-1])
        if change.standing:
            path = _stretched(path, last, last, steps, time_s)
        else:
            path = _stretched(path, max(first - 1, 0), last, steps, time_s)
    return path


def _steps(places: ExternalPlaces, number: int, speed_m_s: float) -> tuple[int, float]:
    """Rows that a change needs, and its duration, s."""
    change = np.abs(places.values[number + 1] - places.values[number])
    turning = np.array([axis.turning for axis in places.axes])
    steps = max(1, int(np.ceil((change / np.where(turning, STEP_RAD, STEP_M)).max(initial=0.0) - 1e-9)))
    return steps, float(change.max(initial=0.0)) / speed_m_s


def _stretched(path: ToolPath, begin: int, last: int, steps: int, time_s: float) -> ToolPath:
    """Rows between two rows with the place going on by one, then all that follow."""
    # Where both rows are the same the tool stands; else it goes on along the rows between them.
    n = len(path)
    stands = begin == last
    pieces = steps if stands else max(1, -(-steps // (last - begin)))
    count = np.ones(n, dtype=np.int64)
    if stands:
        count[last] += steps
    else:
        count[begin + 1 : last + 1] = pieces
    row = np.repeat(np.arange(n), count)
    within = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count) + 1
    columns = {item.name: getattr(path, item.name)[row] for item in fields(ToolPath)}
    place = columns["place"].copy()
    place[row > last] += 1.0
    if stands:
        share = np.where(row == last, (within - 1) / steps, 0.0)
        columns["kind"] = np.where((row == last) & (within > 1), RAPID, columns["kind"])
        columns["time_s"] = columns["time_s"] + np.where(row == last, share, row > last) * time_s
        place += np.where(row == last, share, 0.0)
    else:
        columns, place = _along(path, columns, (row, within, count), (begin, last, time_s), place)
    return ToolPath(**(columns | {"place": place}))


def _along(
    path: ToolPath, columns: dict[str, Float], rows: tuple[Int, Int, Int], span: tuple[int, int, float], place: Float
) -> tuple[dict[str, Float], Float]:
    """Columns where external axes move along with the tool, and its places."""
    (row, within, count), (begin, last, time_s) = rows, span
    inside: Bool = (row > begin) & (row <= last)
    share = np.where(inside, within / count[row], 1.0)
    before = np.maximum(row - 1, 0)
    for name in ("p_part_tcp", "axis_part", "time_s"):
        values = getattr(path, name)
        at = share if values.ndim == 1 else share[:, None]
        columns[name] = np.where(at == 1.0, values[row], values[before] + at * (values[row] - values[before]))
    columns["axis_part"] /= np.linalg.norm(columns["axis_part"], axis=1, keepdims=True)
    done = np.where(inside, (row - begin - 1 + share) / (last - begin), 0.0)
    lasts = max(time_s - float(path.time_s[last] - path.time_s[begin]), 0.0)
    columns["time_s"] = columns["time_s"] + np.where(inside, done, row > last) * lasts
    stands = np.all(path.p_part_tcp[begin : last + 1] == path.p_part_tcp[begin])
    if stands:
        columns["kind"] = np.where(inside, RAPID, columns["kind"])
    return columns, place + np.where(inside, done, 0.0)


def moving(path: ToolPath) -> Bool:
    """(n,) rows to which external axes move."""
    out: Bool = np.diff(path.place, prepend=path.place[:1]) != 0.0
    return out
