"""Place of a logged path on the program's path, and what is wrong with one that lies nowhere.

Both run in one order: lengths along them correspond but for where the log begins. For each beginning the rigid motion
between them has a closed form; the best are refined by the distances of the path's places to the line of the log that
runs their way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.tool_path.curve import StationCurve, matched_lengths, offsets
from counterflex.geometry import pose, rotation

CAP_M: Final = 5.0 * MM
"""A place of the path that the log passes further off counts as if it were so far."""
NEAR_M: Final = 2.0 * MM
"""The log follows the path where it passes nearer than this."""
FITS_M: Final = 1.0 * MM
"""Largest mean distance of a log that is of the path."""
COVERED: Final = 0.9
"""Least share of the program's feed path that a log follows."""
LEAST_SHARE: Final = 0.3
"""Of the path, in the search."""
UNITS: Final = {"inch": 25.4, "m": 1000.0, "um": 1e-3, "cm": 10.0}
"""How many times too small a log in another unit is that is read as mm; likewise too large."""
_COUNT: Final = 60
_REFINED: Final = 4
_STEPS: Final = 25
_TURN_M: Final = 10.0 * MM  # A point that runs at a right angle counts as so much further away
_SAME: Final = (5.0 * MM, 3.0 * DEG)


@dataclass(frozen=True, eq=False)
class PathPlace:
    """A pose that a log may have."""

    T_path_log: Float  # (4, 4) of the log's frame in the frame of the path
    score_m: float  # mean distance of the path's feed places from the log, each at most CAP_M
    share: float  # of the feed places that the log passes within NEAR_M

    @property
    def fits(self) -> bool:
        """The log is of the path, and of nearly all of it."""
        return self.share >= COVERED and self.score_m <= FITS_M


def score(path: StationCurve, feed: Float, log: StationCurve, T_path_log: Float) -> PathPlace:
    """Score of a log in a given pose against the feed places of a path; ``feed`` (m,) is 1 where the path feeds."""
    rows = np.flatnonzero(feed > 0.5)
    distance, _ = _nearest(path, rows, log, _tree(log), T_path_log)
    capped = np.minimum(distance, CAP_M)
    return PathPlace(T_path_log, float(np.mean(capped)), float(np.mean(distance < NEAR_M)))


def places(path: StationCurve, feed: Float, log: StationCurve) -> list[PathPlace]:
    """Poses that a log may have, the best first; empty where it is too short for the path."""
    steps = offsets(path, log, LEAST_SHARE)
    if len(steps) == 0:
        return []
    on_path, on_log = matched_lengths(path, log, steps, _COUNT)
    P, Q = path.at(on_path), log.at(on_log)
    p0, q0 = P.mean(axis=1, keepdims=True), Q.mean(axis=1, keepdims=True)
    U, _, Vt = np.linalg.svd(np.einsum("kmi,kmj->kij", P - p0, Q - q0))
    proper = np.tile([1.0, 1.0, 1.0], (len(steps), 1))
    proper[:, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = np.einsum("kij,kj,kjl->kil", U, proper, Vt)
    left = (P - p0) - np.einsum("kij,kmj->kmi", R, Q - q0)
    cost = np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))
    cost = cost + 0.02 * path.length_m * (1.0 - (on_path[:, -1] - on_path[:, 0]) / path.length_m)
    chosen: list[int] = []
    for k in np.argsort(cost):
        if all(abs(steps[k] - steps[c]) > 0.01 * path.length_m for c in chosen):
            chosen.append(int(k))
        if len(chosen) == _REFINED:
            break
    tree = _tree(log)
    out = []
    for k in chosen:
        T = pose.make(R[k], p0[k, 0] - R[k] @ q0[k, 0])
        out.append(score(path, feed, log, _refined(path, log, tree, T)))
    return sorted(out, key=lambda one: one.score_m)


def searched(path: StationCurve, feed: Float, log: StationCurve, where: str) -> PathPlace:
    """The pose of a log of the whole path in any pose.

    ``path``: of the program, with its rapids; ``feed``: (m,) 1 where it feeds; ``log``: as logged, m, its own frame.

    Raises:
        InputError: It is mirrored, in another unit, of half a path or of another program, or fits in two poses.
    """
    proper = places(path, feed, log)
    if proper and proper[0].fits:
        best = proper[0]
        mirrored = places(path, feed, log.mirrored())
        if mirrored and mirrored[0].score_m < 0.5 * best.score_m - 50.0 * UM:
            raise _mirrored(best, mirrored[0], where)
        other = next((one for one in proper[1:] if one.fits and _differs(one, best, log.points.mean(axis=0))), None)
        if other is not None and other.score_m < 1.25 * best.score_m + 10.0 * UM:
            raise InputError(
                "the log fits the program's path in two poses about as well",
                where=where,
                value=f"{_mm(best.score_m)} and {_mm(other.score_m)} off in the mean",
                hint="Say where the tracker stood: --frame with a cell file or X,Y,Z,A,B,C",
            )
        return best
    raise diagnosed(path, feed, log, where, proper)


def _other_unit(path: StationCurve, feed: Float, log: StationCurve) -> str | None:
    """Words for the unit in which a log would lie on the path, if there is one."""
    for name, factor in UNITS.items():
        for times, text in ((factor, f"it is in {name}"), (1.0 / factor, f"it is {factor:g} times too large")):
            scaled = log.scaled(times)
            fitting = places(path, feed, scaled) if _as_large(path, scaled) else []
            if fitting and fitting[0].fits:
                return text
    return None


def diagnosed(
    path: StationCurve, feed: Float, log: StationCurve, where: str, proper: list[PathPlace] | None = None
) -> InputError:
    """Diagnose a log that does not lie on the path, as an error of one line.

    Args:
        feed: (m,) 1 where it feeds.
        log: As logged, m.
        proper: Poses that it may have; None: they are searched, and one that fits says that the frame is wrong.
    """
    given = proper is None
    proper = places(path, feed, log) if proper is None else proper
    if given and proper and proper[0].fits:
        T = proper[0].T_path_log
        turn = float(np.linalg.norm(rotation.log(T[:3, :3]))) / DEG
        middle = log.points.mean(axis=0)
        moved = float(np.linalg.norm(pose.transform(T, middle[None])[0] - middle))
        return InputError(
            "the log does not lie on the program's path in the frame that was given",
            where=where,
            value=f"moved by {moved / MM:.3g} mm and turned by {turn:.3g} deg it would",
            hint="Is --frame the one in which it was logged? --frame fit lays it on the path",
        )
    mirrored = places(path, feed, log.mirrored())
    if mirrored and mirrored[0].fits:
        return _mirrored(proper[0] if proper else None, mirrored[0], where)
    text = _other_unit(path, feed, log)
    if text is not None:
        return InputError(
            "the log is of another unit than it states",
            where=where,
            value=f"its path fits the program's if {text}",
            limit="lengths in mm",
            hint="Export it in mm",
        )
    best = max(proper, key=lambda one: one.share, default=None)
    if best is not None and LEAST_SHARE <= best.share < COVERED:
        return InputError(
            "the log follows only a part of the program's path",
            where=where,
            value=f"{100.0 * best.share:.0f} % of its feed motion within {NEAR_M / MM:g} mm",
            limit=f">= {100.0 * COVERED:g} %",
            hint="Log the whole program; was the beam interrupted, or another program run?",
        )
    return InputError(
        "the log is not of this program's path",
        where=where,
        value="it fits it in no pose"
        if not proper
        else f"at best {_mm(proper[0].score_m)} off in the mean, {100.0 * proper[0].share:.0f} % of the path followed",
        limit=f"<= {_mm(FITS_M)}, >= {100.0 * COVERED:g} %",
        hint="Is the program the one that ran while it was logged?",
    )


def _as_large(path: StationCurve, log: StationCurve) -> bool:
    """Return whether a log is about as large as the path, or larger: it may hold an approach."""
    size, other = (float(np.linalg.norm(np.ptp(one.points, axis=0))) for one in (path, log))
    return 0.9 * size < other < 5.0 * size


def _mirrored(best: PathPlace | None, other: PathPlace, where: str) -> InputError:
    off = "in no pose" if best is None else f"{_mm(best.score_m)} off in the mean"
    return InputError(
        "the log is mirrored",
        where=where,
        value=f"as it is it lies {off}, {_mm(other.score_m)} with one axis turned over",
        hint="Export it with right-handed axes",
    )


def _tree(log: StationCurve) -> scipy.spatial.cKDTree:
    """Of places and directions: a pass the other way is another place."""
    return scipy.spatial.cKDTree(np.column_stack([log.points, _TURN_M / np.sqrt(2.0) * log.directions]))


def _nearest(
    path: StationCurve, rows: Int, log: StationCurve, tree: scipy.spatial.cKDTree, T: Float
) -> tuple[Float, Int]:
    """Distance of places of the path to the line of the log that runs their way, and the log's station."""
    p = pose.transform(pose.inverse(T), path.points[rows])
    d = path.directions[rows] @ T[:3, :3]
    _, nearest = tree.query(np.column_stack([p, _TURN_M / np.sqrt(2.0) * d]))
    step = p - log.points[nearest]
    along = np.sum(step * log.directions[nearest], axis=1)
    within = np.clip(along, -log.pitch_m, log.pitch_m)
    away: Float = np.linalg.norm(step - within[:, None] * log.directions[nearest], axis=1)
    turned = np.sum(d * log.directions[nearest], axis=1) < 0.5
    return np.where(turned, np.inf, away), nearest


def _refined(path: StationCurve, log: StationCurve, tree: scipy.spatial.cKDTree, T: Float) -> Float:
    """A pose improved by the distances across the path, far places left out."""
    rows = np.arange(0, len(path), max(1, len(path) // 400))
    centre = path.points.mean(axis=0)
    size = max(0.5 * float(np.linalg.norm(np.ptp(path.points, axis=0))), 1e-9)
    for _ in range(_STEPS):
        distance, nearest = _nearest(path, rows, log, tree, T)
        limit = max(3.0 * float(np.median(distance)), 0.5 * MM)
        good = distance < limit
        if good.sum() < 20:
            return T
        p, t = path.points[rows[good]], path.directions[rows[good]]
        q = pose.transform(T, log.points[nearest[good]])
        r = q - p
        r = r - np.sum(r * t, axis=1, keepdims=True) * t
        arm = (q - centre) / size
        J = np.concatenate([np.tile(np.eye(3), (len(p), 1, 1)), -_cross(arm)], axis=2)
        J = J - t[:, :, None] * np.einsum("ni,nij->nj", t, J)[:, None, :]
        H = np.einsum("nij,nik->jk", J, J)
        H += 1e-9 * np.trace(H) * np.eye(6)
        step = -np.linalg.solve(H, np.einsum("nij,ni->j", J, r))
        R = rotation.exp(step[3:] / size)
        T = pose.make(R, centre + step[:3] - R @ centre) @ T
        if float(np.abs(step).max()) < 1e-8:
            break
    return T


def _cross(v: Float) -> Float:
    """(n, 3, 3) matrices of the cross product with (n, 3)."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return out


def _differs(a: PathPlace, b: PathPlace, middle: Float) -> bool:
    """Return whether two poses are not the same for a log about a point (3,)."""
    shift = float(
        np.linalg.norm(pose.transform(a.T_path_log, middle[None]) - pose.transform(b.T_path_log, middle[None]))
    )
    turn = float(np.linalg.norm(rotation.log(a.T_path_log[:3, :3] @ b.T_path_log[:3, :3].T)))
    return shift > _SAME[0] or turn > _SAME[1]


def _mm(value_m: float) -> str:
    return f"{value_m / MM:.3f} mm"
