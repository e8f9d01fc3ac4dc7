"""Poses in a continuous log: where the robot stands still, and which commanded pose each standstill belongs to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.evaluate.iso9283.poses import PoseCycles
from counterflex.geometry import pose, rotation

BLOCK_S: Final = 0.1
STILL_M_S: Final = 1.0 * MM
"""Slower than this, mean over :data:`BLOCK_S` against the next, the robot stands."""
LEAST_S: Final = 0.4
NEAR_M: Final = 20.0 * MM
"""Farther from every commanded pose, a standstill belongs to none."""


@dataclass(frozen=True, eq=False)
class MeasuredStandstill:
    """A stretch of a log in which nothing moves."""

    first: int  # its first reading
    last: int  # its last reading
    p: Float  # (3,) m, mean of the second half of its readings, when the pose has settled
    R: Float | None  # (3, 3) mean orientation there, or None
    time_s: float  # middle of that half


def standstills(time_s: Float, p: Float, R: Float | None = None) -> list[MeasuredStandstill]:
    """Standstills of a log.

    Args:
        time_s: (n,) s, increasing.
        p: (n, 3) m.
        R: (n, 3, 3), or None.
    """
    time, points = as_float("time_s", time_s, (None,)), as_float("p", p, (None, 3))
    if len(time) == 0:
        return []
    block = np.floor((time - time[0]) / BLOCK_S).astype(np.int64)
    first = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(np.append(first, len(time)))
    centre = np.add.reduceat(points, first, axis=0) / count[:, None]
    at = np.add.reduceat(time, first) / count
    speed = np.linalg.norm(np.diff(centre, axis=0), axis=1) / np.diff(at)
    still = np.concatenate([[False], speed < STILL_M_S, [False]])
    edges = np.flatnonzero(np.diff(still.astype(np.int8)))
    out = []
    for a, b in zip(edges[::2], edges[1::2], strict=True):  # blocks a .. b stand
        begin, end = int(first[a]), int(first[b] + count[b]) - 1
        if time[end] - time[begin] < LEAST_S:
            continue
        half = slice((begin + end + 1) // 2, end + 1)
        mean_R = None if R is None else mean_rotation(R[half])
        middle = float(time[half].mean())
        out.append(MeasuredStandstill(begin, end, points[half].mean(axis=0), mean_R, middle))
    return out


def mean_rotation(R: Float) -> Float:
    """Rotation nearest to the mean of rotations (n, 3, 3) (chordal mean)."""
    u, _, vt = np.linalg.svd(R.mean(axis=0))
    out: Float = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return out


def assigned(stands: Sequence[MeasuredStandstill], Ts_command: Float) -> Int:
    """(k,) commanded pose nearest to each standstill, -1 where all are farther than :data:`NEAR_M`."""
    if not stands:
        return np.zeros(0, dtype=np.int64)
    away = np.linalg.norm(np.stack([s.p for s in stands])[:, None] - Ts_command[None, :, :3, 3], axis=2)
    best = np.argmin(away, axis=1)
    out: Int = np.where(away[np.arange(len(best)), best] <= NEAR_M, best, -1)
    return out


def ordered_cycles(which: Int, count: int) -> list[list[int]]:
    """Standstills of each whole cycle, in the order of the commanded poses 0, 1, ..., count - 1.

    A standstill that is not the next one of its cycle ends it; a cycle that is not whole is left out. Standstills that
    belong to no pose (-1) lie between.
    """
    out: list[list[int]] = []
    current: list[int] = []
    for k, pose_number in enumerate(which.tolist()):
        if pose_number < 0:
            continue
        if pose_number != len(current):
            current = []
        if pose_number == len(current):
            current.append(k)
        if len(current) == count:
            out.append(current)
            current = []
    return out


def pose_cycles(
    stands: Sequence[MeasuredStandstill], cycles: Sequence[Sequence[int]], Ts_command: Float
) -> list[PoseCycles]:
    """Attained poses of every commanded one. Raises InputError: there is no whole cycle."""
    if not cycles:
        raise InputError("no cycle goes through all commanded poses in their order")
    out = []
    for k in range(len(Ts_command)):
        mine = [stands[cycle[k]] for cycle in cycles]
        R = None if any(s.R is None for s in mine) else np.stack([s.R for s in mine if s.R is not None])
        out.append(PoseCycles(Ts_command[k], np.stack([s.p for s in mine]), R, np.array([s.time_s for s in mine])))
    return out


def fitted_frame(stands: Sequence[MeasuredStandstill], Ts_command: Float) -> Float:
    """Pose of the log's frame in that of the commands, by the order of the standstills alone: ``T_command_log``.

    The standstills are taken as whole cycles one after the other; of the ways to begin the one that fits best counts.

    Raises:
        InputError: Fewer than three commanded poses or standstills, or they do not follow the order of the poses.
    """
    k = len(Ts_command)
    if k < 3 or len(stands) < k:
        raise InputError("a frame fitted to poses needs three poses and a whole cycle", value=(k, len(stands)))
    p = np.stack([s.p for s in stands])
    best, least = np.eye(4), np.inf
    for begin in range(min(k, len(stands) - k + 1)):
        rows = p[begin : begin + k * ((len(p) - begin) // k)]
        T, rest = pose.register(np.tile(Ts_command[:, :3, 3], (len(rows) // k, 1)), rows)
        rms = float(np.sqrt(np.mean(np.sum(rest**2, axis=1))))
        if rms < least:
            best, least = T, rms
    if least > NEAR_M:
        raise InputError(
            "the standstills of the log do not follow the order of the commanded poses",
            value=f"{least / MM:.1f} mm rms after the fit",
            limit=f"{NEAR_M / MM:g} mm",
            hint="Cut the log to the cycles, or give the frame",
        )
    return best


def fitted_offset(cycles: Sequence[PoseCycles]) -> Float:
    """Mean rotation ``R_target_tcp`` by which measured orientations differ from commanded ones, in target axes."""
    parts = [np.swapaxes(one.R, 1, 2) @ one.command[:3, :3] for one in cycles if one.R is not None]
    out: Float = mean_rotation(np.concatenate(parts)) if parts else rotation.exp(np.zeros(3))
    return out


BAND_M: Final = 0.1 * MM
_READINGS: Final = 10


@dataclass(frozen=True)
class Settled:
    """One approach.

    An excursion counts where it leaves the band by more than the readings at rest scatter: noise on the way in is none.
    """

    time_s: float  # from the first entry into the limit band until the pose stays in it
    # largest distance from the attained pose after that first entry; 0 where it stays within the band
    overshoot_m: float

    @classmethod
    def of(
        cls,
        time_s: Float,
        p: Float,
        before: MeasuredStandstill | None,
        stand: MeasuredStandstill,
        band_m: float = BAND_M,
    ) -> Settled:
        """Stabilisation of one approach.

        Args:
            time_s: (n,) s, of the log.
            p: (n, 3) m.
            before: The standstill before, or None at the beginning of the log.
            stand: The standstill that the approach leads to; its mean is the attained pose.
            band_m: Radius of the limit band about the attained pose.

        Raises:
            InputError: The approach is not in the log, has too few readings, or the noise of the standstill alone
                leaves the band.

        Source: ISO 9283:1998, 7.4 and 7.5.
        """
        first = 0 if before is None else before.last
        away = np.linalg.norm(p[first : stand.last + 1] - stand.p, axis=1)
        half = away[len(away) - max(1, (stand.last - stand.first + 1) // 2) :]
        if float(half.max()) > band_m:
            raise InputError(
                "the pose does not stay in the limit band",
                value=f"{half.max() / MM:.3g} mm",
                limit=f"{band_m / MM:.3g} mm",
                hint="Widen it: --band-mm",
            )
        begin = int(np.argmax(away))
        inside = np.flatnonzero(away[begin:] <= band_m)
        if away[begin] <= band_m or inside[0] == 0 or stand.first - (first + begin) < _READINGS:
            raise InputError("the approach is not in the log, or has too few readings")
        entry = begin + int(inside[0])
        outside = np.flatnonzero(away[entry:] > band_m + float(half.max()))
        last = entry
        if len(outside):
            excursion = entry + int(outside[-1])
            last = excursion + int(np.argmax(away[excursion:] <= band_m))
        time = time_s[first : stand.last + 1]
        return cls(float(time[last] - time[entry]), float(away[entry:].max()) if len(outside) else 0.0)
