"""Scans with a table, a vice or clamps beside the part: where the part lies in them, and what is cut away.

The extent of such a scan says nothing about the part. A pose is proposed by pairs of parallel planes that are as far
apart as two faces of the blank, and judged the other way round: by how much of the nominal part the scan shows.
"""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import DEG, MM
from counterflex.evaluate.inspection.cloud import Cloud
from counterflex.evaluate.inspection.coarse import CoarseReference, Hypothesis, main_axes, refined, same_pose
from counterflex.evaluate.inspection.datum import DatumFaces
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.geometry import pose

CLEARANCE_M: Final = 3.0 * MM
"""Points further from the blank are not of the part. A wall may be off by as much before it is one of another part."""
_FOOTPRINT_M: Final = 0.5 * MM
_CONE: Final = float(np.cos(6.0 * DEG))
_FACING: Final = float(np.cos(20.0 * DEG))
_BIN_M: Final = 0.5 * MM
_PEAK: Final = 0.002  # A plane holds at least this share of the points
_PLANES: Final = 10
_PAIR_M: Final = 1.0 * MM
_PAIRS: Final = 4
_SINGLES: Final = 4
_SHOWN_M: Final = 1.0 * MM
_SAMPLES: Final = 400
_POINTS: Final = 60_000
_REFINED: Final = 6
LEAST_SHOWN: Final = 0.4
"""Share of the nominal part that the best pose must show; the bottom, a third of it or so, lies on the table."""
_CLEARER: Final = 1.1


def off_part(points_part: Float, faces: DatumFaces, clearance_m: float) -> Bool:
    """Return which points are not of the part: further from the blank than a clearance, or of what it stands on.

    Args:
        points_part: (n, 3) m, part frame.
        clearance_m: About the blank, m. Points below its bottom plus the clearance that lie off its footprint are of
            the table.
    """
    away = np.maximum(faces.low - points_part, points_part - faces.high)
    out: Bool = np.any(away > clearance_m, axis=1)
    low = points_part[:, 2] < faces.low[2] + clearance_m
    out |= low & np.any(away[:, :2] > _FOOTPRINT_M, axis=1)
    return out


def without(cloud: Cloud, rows: Bool) -> Cloud:
    """A cloud without some of its points (n,)."""
    kept = ~rows
    return Cloud(cloud.points[kept], cloud.count[kept], cloud.normals[kept], cloud.pitch_m, cloud.outliers)


def cluttered_pose(cloud: Cloud, part: NominalPart) -> Hypothesis | None:
    """The pose in which a scan shows most of the nominal part; None where no pose shows enough or two show as much."""
    usable = np.flatnonzero(np.isfinite(cloud.normals).all(axis=1))
    some = usable[:: max(1, len(usable) // _POINTS)]
    if len(some) < 100:
        return None
    points, normals = cloud.points[some], cloud.normals[some]
    reference = CoarseReference(part)
    rng = np.random.default_rng(0)
    chosen = rng.permutation(len(reference.points))[:_SAMPLES]
    samples, ways = reference.points[chosen], reference.normals[chosen]
    tree = scipy.spatial.cKDTree(points)
    proposals: list[tuple[float, Float]] = []
    for axes in _frames(points, normals):
        proposed = _proposed(points, normals, axes, part.faces)
        proposals += [(shown(tree, normals, samples, ways, T), T) for T in proposed]
    proposals.sort(key=lambda one: -one[0])
    best: list[tuple[float, Hypothesis]] = []
    for _, T in proposals[:_REFINED]:
        moved = pose.transform(T, points)
        near = np.flatnonzero(~off_part(moved, part.faces, CLEARANCE_M))
        if len(near) < 100:
            continue
        few = near[:: max(1, len(near) // 12_000)]
        one = refined([Hypothesis(T, np.inf)], points[few], normals[few], reference)[0]
        best.append((shown(tree, normals, samples, ways, one.T_part_scan), one))
    best.sort(key=lambda one: -one[0])
    if not best or best[0][0] < LEAST_SHOWN:
        return None
    first = best[0]
    if any(first[0] < _CLEARER * s and not same_pose(h.T_part_scan, first[1].T_part_scan) for s, h in best[1:]):
        return None
    return first[1]


def shown(
    tree: scipy.spatial.cKDTree, normals: Float, samples: Float, normals_part: Float, T_part_scan: Float
) -> float:
    """Share of samples of the nominal part that have a point of the scan beside them that looks their way."""
    distance, nearest = tree.query(pose.transform(pose.inverse(T_part_scan), samples), distance_upper_bound=_SHOWN_M)
    near = np.isfinite(distance)
    measured = normals[nearest[near]] @ T_part_scan[:3, :3].T
    agree = np.abs(np.einsum("nk,nk->n", measured, normals_part[near])) > _FACING
    return float(np.count_nonzero(agree)) / len(samples)


def _frames(points: Float, normals: Float) -> list[Float]:
    """Axes (3, 3) by rows that planes of the scan may be square to: the main one, and up to three directions beside."""
    first = main_axes(normals, points)
    out = [first]
    left = normals
    for _ in range(2):
        # planes square to what is known are taken away: a table may have slots askew to the part
        left = left[(np.abs(left @ out[-1][1]) < _CONE) & (np.abs(left @ out[-1][2]) < _CONE)]
        level = left[np.abs(left @ first[0]) < 0.1]
        if len(level) < max(50, 0.01 * len(normals)):
            break
        upright = normals[np.abs(normals @ first[0]) > _CONE]
        out.append(main_axes(np.concatenate([upright[: 3 * len(level)], level]), points))
    return out


def _proposed(points: Float, normals: Float, axes: Float, faces: DatumFaces) -> list[Float]:
    """Poses (4, 4): each proper rotation of the axes onto those of the part, with planes of the scan on its faces."""
    planes = [_planes(points @ axis, np.abs(normals @ axis) > _CONE) for axis in axes]
    out = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            R_part_scan = R @ axes
            if np.linalg.det(R_part_scan) < 0.0:
                continue
            shifts = [_shifts(signs[k] * planes[order[k]], float(faces.low[k]), float(faces.high[k])) for k in range(3)]
            out += [pose.make(R_part_scan, np.array(shift)) for shift in itertools.product(*shifts)]
    return out


def _planes(place: Float, square: Bool) -> Float:
    """Places of planes along an axis, those with most points first."""
    value = place[square]
    if len(value) == 0:
        return np.empty(0)
    bins = np.floor(value / _BIN_M).astype(np.int64)
    number = np.bincount(bins - bins.min())
    smooth = np.convolve(number, np.ones(3), "same")
    padded = np.pad(smooth, 1)
    top = np.flatnonzero((smooth >= padded[:-2]) & (smooth > padded[2:]) & (smooth > _PEAK * len(place)))
    top = top[np.argsort(-smooth[top], kind="stable")][:_PLANES]
    middles = (top + bins.min() + 0.5) * _BIN_M
    return np.array([np.median(value[np.abs(value - middle) < 1.5 * _BIN_M]) for middle in middles])


def _shifts(planes: Float, low: float, high: float) -> list[float]:
    """Ways to lay planes of a scan on two faces: pairs as far apart as these first, then one of them alone."""
    pairs = [
        (abs(b - a - (high - low)), 0.5 * (low - a + high - b))
        for a in planes
        for b in planes
        if abs(b - a - (high - low)) < _PAIR_M
    ]
    out = [shift for _, shift in sorted(pairs)[:_PAIRS]]
    for plane in planes[:_SINGLES]:
        out += [face - plane for face in (low, high)]
    return out
