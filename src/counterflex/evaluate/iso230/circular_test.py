"""Circular tests of ISO 230-4 from a measured path: turns in both directions, G, G(b), F, D, and H (1996)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM


@dataclass(frozen=True)
class Circularity:
    """Figures of one measured circle, m."""

    g_m: float  # circular deviation G: least radial distance between two concentric circles that hold the path
    f_max_m: float  # largest radial deviation F from the nominal circle about its nominal centre; positive = outside
    f_min_m: float  # smallest (most inward) radial deviation F
    centre_offset_m: tuple[float, float]  # (2,) centre of the two circles minus the nominal centre, in the axes given
    radius_m: float  # mean of the two circles' radii

    @classmethod
    def of(cls, points: Float, centre: Float, radius_m: float) -> Circularity:
        """Circular deviation G (minimum zone) and radial deviation F of a path along a circle.

        G solves ``min h - l`` with ``l <= |p_i - c| <= h`` over the centre c as a sequence of linear programs, each
        exact to second order in the step of c.

        Args:
            points: (n, 2) m, n >= 4, path in the plane of the circle, its whole turn or a part of at least 90 deg.
            centre: (2,) m nominal centre.
            radius_m: Nominal radius.

        Raises:
            InputError: Fewer than four points, points at the centre, or an arc of less than 90 deg, which fixes no
                centre.

        Source: ISO 230-4, definitions of circular deviation G and radial deviation F.
        """
        p = as_float("points", points, (None, 2))
        c0 = as_float("centre", centre, (2,))
        nominal = as_positive("radius_m", radius_m)
        if len(p) < 4:
            raise InputError("a circle needs at least four points", value=len(p))
        rho = np.linalg.norm(p - c0, axis=1)
        if float(rho.min()) < 0.1 * nominal:
            raise InputError(
                "a point lies near the centre of the circle", value=float(rho.min()), limit=f"~{nominal:g} m"
            )
        angle = np.sort(np.arctan2(p[:, 1] - c0[1], p[:, 0] - c0[0]))
        widest = float(np.max(np.diff(np.append(angle, angle[0] + 2.0 * np.pi))))
        if widest > 1.5 * np.pi + 1e-9:
            raise InputError("the arc is too short for its centre", value=f"{np.degrees(2 * np.pi - widest):.1f} deg",
                             limit=">= 90 deg")  # fmt: skip
        best = c = c0.copy()
        low, high = float(rho.min()), float(rho.max())
        for _ in range(8):
            away = p - c
            r = np.linalg.norm(away, axis=1)
            u = away / r[:, None]
            middle = float(r.mean())
            # unknowns: step of the centre (2), low and high radius about the mean
            above = np.column_stack([-u, np.zeros(len(p)), -np.ones(len(p))])
            below = np.column_stack([u, np.ones(len(p)), np.zeros(len(p))])
            result = scipy.optimize.linprog(
                [0.0, 0.0, -1.0, 1.0],
                A_ub=np.vstack([above, below]),
                b_ub=np.concatenate([-(r - middle), r - middle]) / nominal,
                bounds=[(None, None)] * 4,
                method="highs",
            )
            step = nominal * np.asarray(result.x[:2], dtype=np.float64)
            c = c + step
            r = np.linalg.norm(p - c, axis=1)
            if float(np.ptp(r)) < high - low:  # the program's tolerance may leave a step that is none
                best, low, high = c, float(r.min()), float(r.max())
            if float(np.abs(step).max()) < 1e-9 * nominal:
                break
        return cls(
            g_m=high - low,
            f_max_m=float(rho.max()) - nominal,
            f_min_m=float(rho.min()) - nominal,
            centre_offset_m=(float(best[0] - c0[0]), float(best[1] - c0[1])),
            radius_m=0.5 * (low + high),
        )


TURN_RAD: Final = 2.0 * np.pi
_LEAST_TURN: Final = 359.0 * DEG
_BACK_RAD: Final = 5.0 * DEG
_BIN_RAD: Final = 0.25 * DEG
_CIRCLE_M: Final = 20.0 * UM
CLOCKWISE: Final = "cw"
COUNTER_CLOCKWISE: Final = "ccw"


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle in space."""

    centre: Float  # (3,) m
    normal: Float  # (3,) unit vector; counter-clockwise is right-handed about it
    radius_m: float

    @property
    def axes(self) -> Float:
        """(2, 3) unit vectors that span the plane, right-handed with the normal; the first nearest to x."""
        x = np.eye(3)[0 if abs(self.normal[0]) < 0.9 else 1]
        x = x - (x @ self.normal) * self.normal
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(self.normal, x)])


def fitted_circle(p: Float) -> Circle:
    """Circle through points (n, 3) m: plane and circle by least squares; normal towards +z (or +y, +x).

    Raises:
        InputError: The points lie on a line.
    """
    points = as_float("p", p, (None, 3))
    centre = points.mean(axis=0)
    _, s, vt = np.linalg.svd(points - centre, full_matrices=False)
    if len(points) < 4 or s[1] < 1e-6 * s[0]:
        raise InputError("points on a line give no circle")
    normal = vt[2]
    main = int(np.argmax(np.abs(normal)))
    normal = normal * np.sign(normal[main])
    plane = Circle(centre, normal, 1.0).axes
    offset, radius = least_squares_circle((points - centre) @ plane.T)
    return Circle(centre + offset @ plane, normal, radius)


def least_squares_circle(points: Float) -> tuple[Float, float]:
    """Centre (2,) m and radius m of the circle with the least sum of squared radial distances (Gauss-Newton)."""
    xy = as_float("points", points, (None, 2))
    a = np.column_stack([2.0 * xy, np.ones(len(xy))])
    start = np.linalg.lstsq(a, np.sum(xy**2, axis=1), rcond=None)[0]
    c = start[:2]
    for _ in range(50):
        away = xy - c
        r = np.linalg.norm(away, axis=1)
        J = np.column_stack([-away / r[:, None], -np.ones(len(r))])
        step = np.linalg.lstsq(J, -(r - r.mean()), rcond=None)[0]
        c = c + step[:2]
        if float(np.abs(step[:2]).max()) < 1e-13:
            break
    return c, float(np.linalg.norm(xy - c, axis=1).mean())


@dataclass(frozen=True, eq=False)
class Turn:
    """One whole turn in one direction."""

    direction: str  # CLOCKWISE or COUNTER_CLOCKWISE, seen against the normal
    points: Float  # (n, 2) m, in the plane of the circle about its centre
    axial_m: float  # range of the path along the normal

    def figures(self, nominal_radius_m: float | None, *, nominal_centre: bool) -> TurnFigures:
        """G and F of one turn.

        ``nominal_radius_m``: or None; ``nominal_centre``: the turns were counted about the nominal centre.

        Source: ISO 230-4:2005, 3.4 and 3.5 (F about the centre of the instrument or the least-squares centre).
        """
        c, radius = least_squares_circle(self.points)
        rho = np.linalg.norm(self.points - c, axis=1)
        about = np.linalg.norm(self.points, axis=1)
        known = nominal_radius_m is not None
        r0 = nominal_radius_m or 0.0
        both = known and nominal_centre
        return TurnFigures(
            direction=self.direction,
            g_m=minimum_zone(self.points),
            g_lsc_m=float(np.ptp(rho)),
            f_max_m=float(rho.max()) - r0 if known else None,
            f_min_m=float(rho.min()) - r0 if known else None,
            f_nominal_max_m=float(about.max()) - r0 if both else None,
            f_nominal_min_m=float(about.min()) - r0 if both else None,
            radius_m=radius,
            centre_m=(float(c[0]), float(c[1])),
            axial_m=self.axial_m,
        )


def turns(p: Float, circle: Circle) -> list[Turn]:
    """Whole turns in a log, one of each stretch that keeps its direction: its middle one.

    What runs in and out, and what is not on the circle, is left out: readings farther than a tenth of the radius from
    it end a stretch.

    Args:
        p: (n, 3) m.
        circle: About which the turns are counted.

    Raises:
        InputError: There is no whole turn.
    """
    away = as_float("p", p, (None, 3)) - circle.centre
    xy, axial = away @ circle.axes.T, away @ circle.normal
    rho = np.linalg.norm(xy, axis=1)
    on = (np.abs(rho - circle.radius_m) < 0.1 * circle.radius_m) & (np.abs(axial) < 0.1 * circle.radius_m)
    out = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    longest = 0.0
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        angle = np.unwrap(np.arctan2(xy[a:b, 1], xy[a:b, 0]))
        for first, last in _one_way(angle):
            swept = angle[last] - angle[first]
            longest = max(longest, abs(float(swept)))
            if abs(swept) < _LEAST_TURN:
                continue
            part = angle[first : last + 1]
            sense = 1.0 if swept > 0.0 else -1.0
            middle = 0.5 * (part[0] + part[-1])
            chosen = a + first + np.flatnonzero(np.abs(part - middle) <= 0.5 * TURN_RAD)
            name = COUNTER_CLOCKWISE if sense > 0.0 else CLOCKWISE
            out.append(Turn(name, xy[chosen], float(np.ptp(axial[chosen]))))
    if not out:
        raise InputError(
            "the log has no whole turn of a circle",
            value=f"at most {longest / DEG:.0f} deg in one direction within {0.1 * circle.radius_m / MM:.3g} mm of it",
            limit="360 deg",
        )
    return out


def _one_way(angle: Float) -> list[tuple[int, int]]:
    """Stretches (first, last) between reversals of more than 5 deg."""
    out, first, extreme, sense = [], 0, 0, 0.0
    for k in range(1, len(angle)):
        if sense == 0.0:
            if abs(angle[k] - angle[first]) > _BACK_RAD:
                sense, extreme = float(np.sign(angle[k] - angle[first])), k
            continue
        if (angle[k] - angle[extreme]) * sense > 0.0:
            extreme = k
        elif (angle[extreme] - angle[k]) * sense > _BACK_RAD:
            out.append((first, extreme))
            first, extreme, sense = extreme, k, -sense
    if len(angle):
        out.append((first, extreme if sense else len(angle) - 1))
    return out


@dataclass(frozen=True)
class TurnFigures:
    """Figures of one turn, m."""

    direction: str  # of the turn
    g_m: float  # circular deviation G: minimum radial separation of two concentric circles that hold the path
    g_lsc_m: float  # the same about the least-squares centre
    f_max_m: float | None  # largest radial deviation F about the least-squares centre; None without a nominal radius
    f_min_m: float | None  # smallest
    f_nominal_max_m: float | None  # largest F about the nominal centre; None where that is not known
    f_nominal_min_m: float | None  # smallest
    radius_m: float  # of the least-squares circle
    centre_m: tuple[float, float]  # (2,) of it, minus that of the circle the turns were counted about
    axial_m: float  # range out of the plane


@dataclass(frozen=True)
class BiDirectional:
    """Figures of a clockwise and a counter-clockwise turn together, m."""

    # bi-directional circular deviation G(b): minimum radial separation of two concentric circles that hold both paths
    g_b_m: float
    g_b_lsc_m: float  # the same about the least-squares centre of both
    # mean bi-directional radial deviation D: radius of the least-squares circle of both minus the nominal radius; None
    # without that
    d_m: float | None
    # circular hysteresis H of the first edition (1996): largest difference of the radii of both paths at one angle,
    # about their common least-squares centre
    h_m: float

    @classmethod
    def of(cls, cw: Turn, ccw: Turn, nominal_radius_m: float | None) -> BiDirectional:
        """G(b), D and H of two turns in opposite directions.

        Source: ISO 230-4:2005, 3.3 and 3.6; H: ISO 230-4:1996.
        """
        both = np.concatenate([cw.points, ccw.points])
        c, radius = least_squares_circle(both)
        rho = np.linalg.norm(both - c, axis=1)
        angle = np.linspace(-np.pi, np.pi, 1440, endpoint=False)
        r_cw, r_ccw = (_radius_at(angle, turn.points - c) for turn in (cw, ccw))
        return cls(
            g_b_m=minimum_zone(both),
            g_b_lsc_m=float(np.ptp(rho)),
            d_m=None if nominal_radius_m is None else radius - nominal_radius_m,
            h_m=float(np.abs(r_cw - r_ccw).max()),
        )


def _radius_at(angle: Float, points: Float) -> Float:
    at = np.arctan2(points[:, 1], points[:, 0])
    order = np.argsort(at)
    out: Float = np.interp(angle, at[order], np.linalg.norm(points, axis=1)[order], period=2.0 * np.pi)
    return out


def minimum_zone(points: Float) -> float:
    """Width of the narrowest ring that holds points (n, 2) m.

    Of each quarter of a degree about the least-squares centre only the innermost and the outermost point can touch it.
    """
    c, radius = least_squares_circle(points)
    away = points - c
    rho = np.linalg.norm(away, axis=1)
    part = np.floor((np.arctan2(away[:, 1], away[:, 0]) + np.pi) / _BIN_RAD).astype(np.int64)
    order = np.lexsort((rho, part))
    first = np.flatnonzero(np.diff(part[order], prepend=-1))
    last = np.append(first[1:], len(order)) - 1
    chosen = np.unique(order[np.concatenate([first, last])])
    return Circularity.of(points[chosen], c, radius).g_m


def require_circle(p: Float, circle: Circle) -> None:
    """Refuse commanded points (n, 3) m that lie on no circle.

    Raises:
        InputError: They leave the fitted circle by more than 20 um.
    """
    away = p - circle.centre
    off = np.hypot(np.linalg.norm(away @ circle.axes.T, axis=1) - circle.radius_m, away @ circle.normal)
    if float(off.max()) > _CIRCLE_M:
        raise InputError(
            "the commanded path is no circle", value=f"{off.max() / MM:.3g} mm off", limit=f"{_CIRCLE_M / MM:g} mm"
        )
