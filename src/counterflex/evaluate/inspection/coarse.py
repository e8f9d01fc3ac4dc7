"""Place of a scan in any pose on the nominal part: its main planes turned in every way onto those of the part."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.inspection.cloud import Cloud
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.geometry import pose

CAP_M: Final = 5.0 * MM
"""A point further from the nominal part counts as if it were so far: scores are trimmed means."""
WORST_M: Final = 0.8 * MM
"""Largest score of a pose that a scan may have: of what was machined much may be off by a millimetre."""
_PITCH_M: Final = 1.5 * MM
_CONE: Final = np.cos(6.0 * DEG)
_LINED_UP: Final = np.cos(30.0 * DEG)
_ASKEW_M: Final = 0.5 * MM
"""A point whose normal is not that of the nearest sample counts as at least so far off: at edges none fits."""
_LEAST_ACROSS: Final = 0.02
_SCORED: Final = 1500
_REFINED: Final = 8
_SAME: Final = (5.0 * MM, 3.0 * DEG)


class NoPose(InputError):
    """A scan fits the part in no pose as it is; it may in a part of it."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose that a scan may have."""

    T_part_scan: Float  # (4, 4) of the scan's frame in the part; its determinant is negative where the scan is mirrored
    score_m: float  # trimmed mean distance of the scan's points to the nominal part


class CoarseReference:
    """Samples of the nominal part, to score poses against."""

    def __init__(self, part: NominalPart, outside_m: float = 0.0) -> None:
        """Prepare samples; the points of the scan lie so far outside of the part, as centres of a probe's ball do."""
        self.outside_m = outside_m
        self.pitch_m = max(_PITCH_M, float(np.sqrt(part.area_m2 / 60_000)))
        self.points, self.normals = part.samples(self.pitch_m)
        self.tree = scipy.spatial.cKDTree(self.points)

    def score(self, points: Float, normals: Float) -> float:
        """Trimmed mean distance of points (n, 3), in part frame, along the normals of the nearest samples, m."""
        distance, nearest = self.tree.query(points, distance_upper_bound=CAP_M)
        near = np.isfinite(distance)
        index = nearest[near]
        flat = np.abs(np.sum((points[near] - self.points[index]) * self.normals[index], axis=1) - self.outside_m)
        aligned = np.abs(np.sum(normals[near] * self.normals[index], axis=1)) > _LINED_UP
        aside = distance[near] > 2.0 * self.pitch_m
        off = np.where(aside | ~aligned, np.maximum(distance[near], flat), flat)
        off = np.where(aligned, off, np.maximum(off, _ASKEW_M))
        return float((off.sum() + CAP_M * np.count_nonzero(~near)) / max(len(points), 1))


def coarse_pose(cloud: Cloud, part: NominalPart, where: str, ball_radius_m: float = 0.0) -> Hypothesis:
    """The pose of a scan that is far better than every other one.

    Main planes are the directions in which most normals lie. They are turned onto the part's axes in all 24 ways (and
    the 24 that mirror), the extent of the scan is laid on the near, the far and the middle of the part's; the best are
    refined by ICP (point to plane) on the whole part, and scored again.

    ``ball_radius_m``: where the points are centres of a probe's ball: its radius, m.

    Raises:
        InputError: The scan is mirrored, of another size, of another part, or fits in two poses about as well.
    """
    reference = CoarseReference(part, ball_radius_m)
    usable = np.flatnonzero(np.isfinite(cloud.normals).all(axis=1))
    some = usable[:: max(1, len(usable) // (8 * _SCORED))]
    points, normals = cloud.points[some], cloud.normals[some]
    axes = main_axes(normals, points)
    across = float(np.mean(np.abs(normals @ axes[0]) < _CONE))
    if across < _LEAST_ACROSS:
        raise InputError(
            "the scan shows faces that look in one direction only, which leave three of six freedoms open",
            where=where,
            value=f"{100.0 * across:.1f} % of its points face elsewhere",
            limit=f">= {100.0 * _LEAST_ACROSS:g} %",
            hint="Scan the sides of the blank too",
        )
    first = _hypotheses(points, normals, axes, part, reference)
    sense = [float(np.linalg.det(one.T_part_scan[:3, :3])) for one in first]
    proper, mirrored = (
        refined([h for h, s in zip(first, sense, strict=True) if s * way > 0.0], points, normals, reference)
        for way in (1.0, -1.0)
    )
    best = proper[0]
    clear = 0.5 * best.score_m - 50.0 * UM
    if mirrored[0].score_m < clear:
        raise InputError(
            "the scan is mirrored",
            where=where,
            value=f"its points are {_mm(best.score_m)} off the part in the mean, {_mm(mirrored[0].score_m)} "
            "with one axis turned over",
            hint="Export it again with right-handed axes",
        )
    if best.score_m > WORST_M:
        raise NoPose(
            "the scan fits the part in no pose",
            where=where,
            value=f"{_mm(best.score_m)} off in the mean"
            if np.isfinite(best.score_m)
            else f"points over {_extent(points, axes)}",
            limit=f"<= {_mm(WORST_M)}" if np.isfinite(best.score_m) else _size(part),
            hint="Is it a scan of this part, and the program the one that made it? Were tables, clamps and "
            "stray points cut away? --datum-points gives the pose",
        )
    other = next((one for one in proper[1:] if not same_pose(one.T_part_scan, best.T_part_scan)), None)
    if other is not None and other.score_m < 1.25 * best.score_m + 10.0 * UM:
        raise InputError(
            "the scan fits the part in two poses about as well",
            where=where,
            value=f"{_mm(best.score_m)} and {_mm(other.score_m)} off in the mean",
            hint="Give three or more points of the scan and of the part: --datum-points FILE, or --aligned "
            "where the scan is in the part frame already",
        )
    return best


def _extent(points: Float, axes: Float) -> str:
    """Extent of all but a few points (n, 3) along their main axes."""
    ends = np.percentile(points @ axes.T, [0.3, 99.7], axis=0)
    return " x ".join(f"{v / MM:.0f}" for v in sorted(ends[1] - ends[0], reverse=True)) + " mm"


def _size(part: NominalPart) -> str:
    """Of the blank."""
    sides = sorted(part.faces.high - part.faces.low, reverse=True)
    return "a blank of " + " x ".join(f"{v / MM:.0f}" for v in sides) + " mm"


def _mm(value_m: float) -> str:
    return f"{value_m / MM:.3f} mm"


def main_axes(normals: Float, points: Float) -> Float:
    """Three directions (3, 3) by rows, square to each other, in which most normals (n, 3) lie.

    Where a second one is not to be found, the principal axes of the points (n, 3) across the first serve.
    """
    rng = np.random.default_rng(0)
    first = _main_direction(normals, rng)
    across = normals - np.outer(normals @ first, first)
    side = np.linalg.norm(across, axis=1)
    level = side > np.cos(10.0 * DEG)
    if level.sum() >= max(20, 0.01 * len(normals)):
        second = _main_direction(across[level] / side[level, None], rng)
    else:
        flat = points - points.mean(axis=0)
        flat = flat - np.outer(flat @ first, first)
        second = np.linalg.svd(flat, full_matrices=False)[2][0]
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)])


def _main_direction(normals: Float, rng: np.random.Generator) -> Float:
    some = normals[rng.integers(0, len(normals), min(300, len(normals)))]
    count = (np.abs(normals @ some.T) > _CONE).sum(axis=0)
    direction = some[int(np.argmax(count))]
    for _ in range(5):
        close = normals[np.abs(normals @ direction) > _CONE]
        direction = np.linalg.eigh(close.T @ close)[1][:, -1]
    out: Float = direction
    return out


def _hypotheses(
    points: Float, normals: Float, axes: Float, part: NominalPart, reference: CoarseReference
) -> list[Hypothesis]:
    """All ways to lay the axes of the scan on those of the part."""
    low, high = part.faces.low, part.faces.high
    every = max(1, len(points) // _SCORED)
    out = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            R_part_scan = R @ axes
            turned = points @ R_part_scan.T
            ends = np.percentile(turned, [0.3, 99.7], axis=0)
            if np.any(ends[1] - ends[0] > high - low + 2.0 * CAP_M):
                continue
            steps = np.stack([low - ends[0], high - ends[1]])
            fits = np.abs(steps[1] - steps[0]) < 2.0 * MM
            ways = [(0.5 * (steps[0, k] + steps[1, k]),) if fits[k] else tuple(steps[:, k]) for k in range(3)]
            for shift in itertools.product(*ways):
                score = reference.score(turned[::every] + shift, normals[::every] @ R_part_scan.T)
                out.append(Hypothesis(pose.make(R_part_scan, np.array(shift)), score))
    return out


def refined(first: list[Hypothesis], points: Float, normals: Float, reference: CoarseReference) -> list[Hypothesis]:
    """The best, refined on the whole part and scored again, best first; one that is no pose where there is none."""
    if not first:
        return [Hypothesis(np.eye(4), np.inf)]
    import small_gicp  # heavy

    target = small_gicp.PointCloud(reference.points / MM)
    tree = small_gicp.KdTree(target)
    small_gicp.estimate_normals(target, tree, num_neighbors=9)
    out: list[Hypothesis] = []
    for one in sorted(first, key=lambda h: h.score_m)[:_REFINED]:
        moved = pose.transform(one.T_part_scan, points)
        source = small_gicp.PointCloud(moved / MM)
        result = small_gicp.align(
            target,
            source,
            tree,
            registration_type="PLANE_ICP",
            max_correspondence_distance=CAP_M / MM,
            max_iterations=40,
            translation_epsilon=1e-4,
            rotation_epsilon=1e-6,
        )
        T = np.asarray(result.T_target_source, np.float64).copy()
        T[:3, 3] *= MM
        better = T @ one.T_part_scan
        score = reference.score(pose.transform(better, points), normals @ better[:3, :3].T)
        out.append(replace(one, T_part_scan=better, score_m=score) if score < one.score_m else one)
    return sorted(out, key=lambda h: h.score_m)


def same_pose(T_a: Float, T_b: Float) -> bool:
    """Return whether two poses are the same within the reach of the refinement."""
    step = T_a @ np.linalg.inv(T_b)
    angle = np.arccos(np.clip(0.5 * (np.trace(step[:3, :3]) - 1.0), -1.0, 1.0))
    return bool(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]) <= _SAME[0] and angle <= _SAME[1])
