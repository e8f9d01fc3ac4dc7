"""Errors that all faces of a scan have in common: its scale, and the radius of a probe's ball.

A scan that is larger by ``s`` moves a face by ``s n . (p - c)``; points that are centres of a ball of radius ``r`` move
every face by ``r``. Neither is a pose, so that no registration takes it away, and both read as errors of the part.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.datum import NAMES, DatumFaces
from counterflex.evaluate.inspection.part_deviations import FREE, PartDeviations

AXES: Final = ("x", "y", "z")
_PATCH_M: Final = 8.0 * MM
_ALONG: Final = 0.99
_LEAST_SIGMA_M: Final = 1.0 * UM  # Of the mean of one patch: flatness of a face is never known better
_SAME: Final = 3.0
"""Directions agree when their scales differ by less than so many standard deviations, or a third of their mean."""
BALL_M: Final = 0.2 * MM
"""Smaller radii are no probe's ball, and a machined part may be off by as much on all sides."""
_EXPLAINS: Final = 0.35


@dataclass(frozen=True)
class ScaleEstimate:
    """Scale of a scan against the blank of the cell file."""

    # by axis, size of the scan by that of the blank, less 1; axes of which both faces were measured
    directions: dict[str, float]
    sigmas: dict[str, float]  # standard deviation of each
    scale: float  # weighted mean of the directions that agree, or of all, less 1; nan where no direction is known
    sigma: float  # standard deviation of it; the scatter of the directions is in it
    # axes, two or three, in which the scale is the same: a scale of the scan. One alone, or directions that differ, may
    # as well be the blank, which is sawn or cast
    agreeing: tuple[str, ...] = ()

    @property
    def common(self) -> bool:
        """True where two or three directions agree."""
        return bool(self.agreeing)

    @property
    def significant(self) -> bool:
        """True where the scale, or that of one direction alone, differs from 1 by more than two standard deviations."""
        if self.common:
            return abs(self.scale) > 2.0 * self.sigma
        return any(abs(self.directions[axis]) > 2.0 * self.sigmas[axis] for axis in self.directions)


def scale_of(rows: PartDeviations, faces: DatumFaces) -> ScaleEstimate:
    """Scale by opposite faces of the blank that the program leaves alone.

        s = (d_low + d_high) / size,  d the mean distance of a face from its plane, positive = outside

    The standard deviation of a mean distance is that of patches of 8 mm.

    Args:
        rows: Deviations of the scan; those of free faces count.
    """
    scales, sigmas = {}, {}
    for k, axis in enumerate(AXES):
        sides = [_mean(rows, faces, NAMES[2 * k + high]) for high in (0, 1)]
        size = float(faces.high[k] - faces.low[k])
        if sides[0] is not None and sides[1] is not None:
            scales[axis] = (sides[0][0] + sides[1][0]) / size
            sigmas[axis] = float(np.hypot(sides[0][1], sides[1][1])) / size
    if not scales:
        return ScaleEstimate({}, {}, np.nan, np.nan)
    for count in (3, 2):
        alike = [
            (chi, mean, sigma, axes)
            for axes in itertools.combinations(scales, count)
            for mean, sigma, chi, agree in (_combined(axes, scales, sigmas),)
            if agree
        ]
        if alike:
            _, mean, sigma, axes = min(alike)
            return ScaleEstimate(scales, sigmas, mean, sigma, axes)
    mean, sigma, _, _ = _combined(tuple(scales), scales, sigmas)
    return ScaleEstimate(scales, sigmas, mean, sigma)


def _combined(
    axes: tuple[str, ...], scales: dict[str, float], sigmas: dict[str, float]
) -> tuple[float, float, float, bool]:
    """Weighted mean of directions, its standard deviation, their scatter by it, and whether they agree."""
    value, sigma = np.array([scales[axis] for axis in axes]), np.array([sigmas[axis] for axis in axes])
    weight = sigma**-2.0
    mean = float(np.average(value, weights=weight))
    chi = float(np.sum(weight * (value - mean) ** 2)) / max(len(value) - 1, 1)
    agree = bool(np.all(np.abs(value - mean) <= np.maximum(_SAME * sigma, abs(mean) / 3.0)))
    return mean, float(np.sqrt(max(1.0, chi) / weight.sum())), chi, agree


def _mean(rows: PartDeviations, faces: DatumFaces, name: str) -> tuple[float, float] | None:
    """Mean distance of the points on a face from its plane and its standard deviation, m; None without points."""
    normal, _ = faces.plane(name)
    some = np.flatnonzero((rows.face == FREE) & (rows.normals @ normal > _ALONG))
    some = some[faces.on(name, rows.points[some])]
    if len(some) < 3:
        return None
    value = _patch_means(rows, some)
    scatter = float(np.std(value, ddof=1)) if len(value) > 3 else float(np.median(rows.standard_deviation_m[some]))
    return float(np.mean(value)), max(scatter, _LEAST_SIGMA_M) / float(np.sqrt(len(value)))


def _patch_means(rows: PartDeviations, some: Int) -> Float:
    """Median deviation in each patch of 8 mm."""
    _, patch = np.unique(np.rint(rows.points[some] / _PATCH_M).astype(np.int64), axis=0, return_inverse=True)
    patch = patch.ravel()
    order = np.argsort(patch, kind="stable")
    pieces = np.split(rows.deviation_m[some][order], np.flatnonzero(np.diff(patch[order])) + 1)
    return np.array([np.median(piece) for piece in pieces])


def common_offset(rows: PartDeviations, centre: Float, fitted: Bool | bool) -> float | None:
    """Offset along all normals that explains the deviations of a scan, m; None where none does.

    Means of patches, each direction of the normals alike, are fitted twice: with the pose alone (nothing where the
    scan was in the part frame), and with an offset common to all faces. It counts where it is larger than 0.2 mm and
    what it leaves is less than a third.

    ``centre``: (3,) m, about which turns are counted; ``fitted``: whether the pose was fitted.
    """
    if len(rows) < 12:
        return None
    way = np.rint(2.0 * rows.normals).astype(np.int64)
    key = np.column_stack([way, np.rint(rows.points / _PATCH_M).astype(np.int64), rows.face])
    _, first, patch, number = np.unique(key, axis=0, return_index=True, return_inverse=True, return_counts=True)
    patch = patch.ravel()
    mean = np.bincount(patch, rows.deviation_m) / number
    _, of_way, many = np.unique(way[first], axis=0, return_inverse=True, return_counts=True)
    weight = 1.0 / np.sqrt(many[of_way.ravel()])
    normals, points = rows.normals[first], rows.points[first]
    ways = {tuple(row) for row in way[first].tolist()}
    opposite = any(tuple(-v for v in row) in ways for row in ways)
    if fitted and not opposite:
        return None  # three faces that look in three directions are laid on the part whatever their offset is
    pose = np.column_stack([normals, np.cross(points - centre, normals) / 0.1]) if fitted else np.empty((len(mean), 0))
    before = _left(pose, mean, weight)[1]
    solution, after = _left(np.column_stack([pose, np.ones(len(mean))]), mean, weight)
    offset = float(solution[-1])
    free = rows.face[first] == FREE
    if not fitted:
        if free.any() and abs(float(np.median(mean[free])) - offset) > 0.25 * abs(offset):
            return None
        if not free.any() and not opposite:
            return None
    return offset if abs(offset) > BALL_M and after < _EXPLAINS * before else None


def _left(A: Float, value: Float, weight: Float) -> tuple[Float, float]:
    """Least-squares solution, the worst tenth left out, and the root mean square of what it leaves."""
    kept = np.ones(len(value), np.bool_)
    solution: Float = np.zeros(A.shape[1])
    for _ in range(3):
        w = weight * kept
        if A.shape[1]:
            solution = np.asarray(np.linalg.lstsq(A * w[:, None], value * w, rcond=None)[0], np.float64)
        off = np.abs(value - A @ solution)
        kept = off <= np.quantile(off, 0.9)
    rest = (value - A @ solution)[kept]
    return solution, float(np.sqrt(np.average(rest**2, weights=weight[kept] ** 2)))


def ball_error(offset_m: float, where: str) -> InputError:
    """The error of a scan all of whose faces are off by the same.

    Args:
        offset_m: By how much, positive = outside of the part.
    """
    side = "outside" if offset_m > 0.0 else "inside"
    hint = (
        f"If they are centres of the probe's ball, give --ball-diameter-mm {2.0 * offset_m / MM:.3g}; if they lie on "
        "the surface, --ball-diameter-mm 0"
        if offset_m > 0.0
        else "Was the radius of the ball taken away twice, or to the wrong side? If not: --ball-diameter-mm 0"
    )
    return InputError(
        f"every face of the scan lies {side} of the part by the same distance",
        where=where,
        value=f"{abs(offset_m) / MM:.3f} mm",
        limit=f"<= {BALL_M / MM:g} mm, as points of a surface do",
        hint=hint,
    )
