"""Pose accuracy AP, pose repeatability RP, variation vAP, distance AD and RD (ISO 9283:1998, 7.2, 7.3).

Angles a, b, c turn about the x, y and z axes of the base, as the standard names them (ISO 9787). They are taken as the
components of the rotation vector that leads from the commanded to the attained orientation: for the small deviations
that are measured this is the difference of the angles, and it has no singular posture.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.evaluate.iso9283 import intervals
from counterflex.geometry import rotation


@dataclass(frozen=True, eq=False)
class PoseCycles:
    """One commanded pose, attained n times from the same direction; in the frame of the commands."""

    command: Float  # (4, 4) commanded pose
    p: Float  # (n, 3) m, attained positions
    R: Float | None = None  # (n, 3, 3) attained orientations, or None where only positions were measured
    time_s: Float | None = None  # (n,) when, or None

    def __post_init__(self) -> None:
        """Check shapes. Raises InputError: no cycle, or lengths that differ."""
        as_float("command", self.command, (4, 4))
        n = len(as_float("p", self.p, (None, 3)))
        if n == 0:
            raise InputError("a pose was never attained")
        if self.R is not None:
            as_float("R", self.R, (n, 3, 3))

    @property
    def turned(self) -> Float | None:
        """(n, 3) rad, rotation vectors a, b, c from the commanded to the attained orientation."""
        return None if self.R is None else rotation.log(self.R @ self.command[:3, :3].T)

    def part(self, rows: Int) -> PoseCycles:
        """Some of the cycles."""
        R, time_s = (None if x is None else x[rows] for x in (self.R, self.time_s))
        return PoseCycles(self.command, self.p[rows], R, time_s)


@dataclass(frozen=True)
class PoseFigures:
    """Figures of one pose."""

    ap: intervals.FigureInterval  # positioning accuracy `AP_P = |mean - command|`, m
    ap_xyz: tuple[intervals.FigureInterval, ...]  # its components `mean - command`, m
    ap_abc: tuple[intervals.FigureInterval, ...]  # orientation accuracy, rad; empty without orientation
    rp: intervals.FigureInterval | None  # positioning repeatability `RP_l = mean(l) + 3 S_l`, m; None with one cycle
    rp_abc: tuple[intervals.FigureInterval, ...]  # orientation repeatability `3 S`, rad

    @classmethod
    def of(cls, cycles: PoseCycles) -> PoseFigures:
        """AP and RP of one pose.

        ``AP_P = sqrt((x - xc)^2 + (y - yc)^2 + (z - zc)^2)`` of the barycentre of the attained positions;
        ``RP_l = mean(l) + 3 S_l`` with ``l`` the distances from the barycentre and ``S_l`` with n - 1; ``RP_a = 3
        S_a``.

        Source: ISO 9283:1998, 7.2.1 and 7.2.2.
        """
        n = len(cycles.p)
        d = cycles.p - cycles.command[:3, 3]
        scatter = np.cov(d.T) / n if n > 1 else np.zeros((3, 3))
        turned = cycles.turned
        angles = () if turned is None else tuple(turned.T)
        return cls(
            ap=intervals.length_figure(d.mean(axis=0), scatter, n),
            ap_xyz=tuple(intervals.mean_figure(x) for x in d.T),
            ap_abc=tuple(intervals.mean_figure(x) for x in angles),
            rp=intervals.largest_repeatability(cycles.p[None]) if n > 1 else None,
            rp_abc=tuple(intervals.three_sigma(x) for x in angles) if n > 1 else (),
        )


def _difference(one: Float, other: Float) -> intervals.FigureInterval:
    """Distance of two means with its uncertainty."""
    scatter = np.zeros((3, 3))
    for x in (one, other):
        if len(x) > 1:
            scatter += np.diag(np.var(x, axis=0, ddof=1)) / len(x) if x.shape[1] == 1 else np.cov(x.T) / len(x)
    return intervals.length_figure(one.mean(axis=0) - other.mean(axis=0), scatter, min(len(one), len(other)))


def multi_directional(
    directions: Sequence[PoseCycles],
) -> tuple[intervals.FigureInterval, tuple[intervals.FigureInterval, ...]]:
    """Variation vAP of the accuracy of one pose attained from several directions: position m, angles a, b, c rad.

    ``vAP_P = max |mean_h - mean_k|`` over pairs of directions; ``vAP_a = max |a_h - a_k|``.

    Raises:
        InputError: Fewer than two directions.

    Source: ISO 9283:1998, 7.2.3 (three directions, 30 cycles each).
    """
    if len(directions) < 2:
        raise InputError("a variation needs two directions of approach", value=len(directions), limit=">= 2")
    pairs = list(itertools.combinations(directions, 2))
    position = max((_difference(h.p, k.p) for h, k in pairs), key=lambda f: f.value)
    if any(one.turned is None for one in directions):
        return position, ()
    angles = []
    for axis in range(3):
        only = np.zeros(3)
        only[axis] = 1.0
        turned = [(h.turned * only, k.turned * only) for h, k in pairs if h.turned is not None and k.turned is not None]
        angles.append(max((_difference(h, k) for h, k in turned), key=lambda f: f.value))
    return position, tuple(angles)


@dataclass(frozen=True)
class DistanceFigures:
    """Figures of the distance between two commanded poses."""

    commanded_m: float  # commanded distance
    ad: intervals.FigureInterval  # `AD_P = mean(D) - D_c`, m, signed
    rd: intervals.FigureInterval | None  # `RD = 3 S_D`, m; None with one cycle
    ad_xyz: tuple[intervals.FigureInterval, ...]  # components `mean |x1 - x2| - |x1c - x2c|`, m
    rd_xyz: tuple[intervals.FigureInterval, ...]  # their `3 S`, m

    @classmethod
    def of(cls, one: PoseCycles, other: PoseCycles) -> DistanceFigures:
        """AD and RD between two poses, cycle by cycle.

        ``D_j = |P_1j - P_2j|``, ``AD_P = mean(D) - D_c``, ``RD = 3 S_D``; by axis with ``D_xj = |x_1j - x_2j|``.

        Raises:
            InputError: The poses were attained a different number of times.

        Source: ISO 9283:1998, 7.3.2 and 7.3.3.
        """
        if len(one.p) != len(other.p):
            raise InputError(
                "the two poses of a distance have other numbers of cycles", value=(len(one.p), len(other.p))
            )
        difference = one.p - other.p
        commanded = one.command[:3, 3] - other.command[:3, 3]
        size = float(np.linalg.norm(commanded))
        d = np.linalg.norm(difference, axis=1) - size
        by_axis = (np.abs(difference) - np.abs(commanded)).T
        repeated = len(d) > 1
        return cls(
            commanded_m=size,
            ad=intervals.mean_figure(d),
            rd=intervals.three_sigma(d) if repeated else None,
            ad_xyz=tuple(intervals.mean_figure(x) for x in by_axis),
            rd_xyz=tuple(intervals.three_sigma(x) for x in by_axis) if repeated else (),
        )


@dataclass(frozen=True)
class PoseDrift:
    """Drift of one pose over blocks of cycles."""

    time_s: Float  # (k,) mean time of each block
    ap_m: Float  # (k,) AP of each block
    rp_m: Float  # (k,) RP of each block
    dap_m: float  # `dAP_P = max |AP_0 - AP_T|`
    drp_m: float  # `dRP_l = max |RP_0 - RP_T|`
    # farthest that a barycentre lies from the first one; not a figure of the standard, which cannot tell a pose that
    # drifts around its command from one that stays
    moved_m: float


def drift(cycles: PoseCycles, block: int = 10) -> PoseDrift | None:
    """Drift of pose accuracy and repeatability over successive blocks of cycles; None where there is one block only.

    Args:
        cycles: One pose, with times.
        block: Cycles in a block.

    Source: ISO 9283:1998, 7.6 (blocks of ten cycles over eight hours).
    """
    blocks = len(cycles.p) // block
    if blocks < 2 or cycles.time_s is None:
        return None
    p = cycles.p[: blocks * block].reshape(blocks, block, 3)
    centre = p.mean(axis=1)
    ap = np.linalg.norm(centre - cycles.command[:3, 3], axis=1)
    rp = np.array([intervals.largest_repeatability(x[None]).value for x in p])
    return PoseDrift(
        time_s=cycles.time_s[: blocks * block].reshape(blocks, block).mean(axis=1),
        ap_m=ap,
        rp_m=rp,
        dap_m=float(np.abs(ap - ap[0]).max()),
        drp_m=float(np.abs(rp - rp[0]).max()),
        moved_m=float(np.linalg.norm(centre - centre[0], axis=1).max()),
    )
