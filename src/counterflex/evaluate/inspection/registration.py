"""A scan laid on the nominal part by its datum faces, and how well that is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.cloud import Cloud
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.inspection.size_errors import BALL_M, ball_error
from counterflex.geometry import pose, rotation

FREEDOMS: Final = ("shift along x", "shift along y", "shift along z", "turn about x", "turn about y", "turn about z")
LEAST_EIGENVALUE: Final = 1e-3
"""A freedom with a smaller eigenvalue, as share of the largest, is left open by the datum faces."""
LARGEST_RESIDUAL_M: Final = 0.5 * MM
LEAST_POINTS: Final = 6
SCALE: Final = 1e-3
"""A part of wrong scale is off by more than this in two or three directions alike."""
_OPPOSITE: Final = (("x-", "x+"), ("y-", "y+"), ("bottom", "top"))
_ALIKE: Final = 0.2
_ALIGNED: Final = 0.9
_PATCH_M: Final = 8.0 * MM
_TUKEY: Final = 4.685
_LIMITS_M: Final = (3.0 * MM, 1.5 * MM, 1.0 * MM)


@dataclass(frozen=True, eq=False)
class Registration:
    """The pose of a scan on the nominal part."""

    T_part_scan: Float  # (4, 4) of the scan's frame in the part
    covariance: Float  # (6, 6) of small shifts (m) and turns (rad) of the scan about `centre`, part axes
    centre: Float  # (3,) m, part frame, about which turns are counted
    faces: tuple[str, ...]  # names of the datum faces
    points: dict[str, int]  # by face, how many points placed it
    offset_m: dict[str, float]  # by face, mean distance of its points from the plane, m, positive = outside
    residual_m: float  # root mean square distance of all of them
    # largest by smallest eigenvalue of the information on the six freedoms, turns at half the diagonal of the blank; 1
    # is best
    condition: float

    def sensitivity(self, points: Float, normals: Float) -> Float:
        """(n, 6) change of the deviation at points (n, 3), along normals (n, 3), by shifts and turns of the scan."""
        out: Float = np.concatenate([normals, np.cross(points - self.centre, normals)], axis=1)
        return out

    def standard_deviation_m(self, points: Float, normals: Float) -> Float:
        """(n,) of deviations at points along normals, by the uncertainty of the pose alone, m."""
        J = self.sensitivity(points, normals)
        out: Float = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", J, self.covariance, J), 0.0))
        return out


def aligned(part: NominalPart, T_part_scan: Float) -> Registration:
    """The registration of a scan whose pose (4, 4) in the part is known: nothing is fitted, it has no uncertainty."""
    centre = 0.5 * (part.faces.low + part.faces.high)
    return Registration(T_part_scan, np.zeros((6, 6)), centre, (), {}, {}, 0.0, 1.0)


def register(
    cloud: Cloud,
    part: NominalPart,
    T_start: Float,
    names: tuple[str, ...],
    where: str,
    ball_radius_m: float | None = None,
) -> Registration:
    """Lay a scan on the datum faces of the nominal part.

    ICP on samples of the faces first, then robust least squares (Tukey's weights) of the distances to their exact
    planes, ``r = n . p - d``. The covariance is that of residuals in patches of 8 mm, each patch as one
    (sandwich estimator): flatness of the faces and errors common to neighbouring points count fully.

    ``T_start``: (4, 4) about the pose of the scan in the part. ``names``: datum faces. ``ball_radius_m``: where the
    points are centres of a probe's ball: its radius, m; None: not known.

    Raises:
        InputError: Too few points on the faces, freedoms that they leave open, faces that do not fit, wrong scale.
    """
    usable = np.isfinite(cloud.normals).all(axis=1) if len(cloud) > 500 else np.ones(len(cloud), np.bool_)
    points, normals = cloud.points[usable], cloud.normals[usable]
    ball = ball_radius_m or 0.0
    T = _icp(points, part, T_start, names) if len(points) > 500 and ball == 0.0 else T_start
    centre = 0.5 * (part.faces.low + part.faces.high)
    scale, middle = 0.0, np.zeros(len(names))
    for limit in (*_LIMITS_M, *([0.0] * 12)):
        p = pose.transform(T, points)
        n = normals @ T[:3, :3].T
        gate = np.full(len(names), limit or 6.0 * scale + 20.0 * UM)
        face, off = _on_faces(p, n, part, names, gate, middle if not limit else np.zeros(len(names)), ball)
        rows = np.flatnonzero(face >= 0)
        _check_count(len(rows), names, where)
        r = off[rows]
        planes = np.stack([part.faces.plane(name)[0] for name in names])[face[rows]]
        J = np.concatenate([planes, np.cross(p[rows] - centre, planes)], axis=1)
        # faces of a blank of another size are off as a whole: what is an outlier is judged on each by itself
        middle = _medians(r, face[rows], len(names))
        scatter = r - middle[face[rows]]
        scale = max(1.4826 * float(np.median(np.abs(scatter))), 1.0 * UM)
        weight = np.maximum(0.0, 1.0 - (scatter / max(_TUKEY * scale, 2.0 * limit)) ** 2) ** 2
        H, condition = _information(J, weight, part, names, where)
        step: Float = -np.linalg.solve(H, J.T @ (weight * r)).astype(np.float64)
        R = rotation.exp(step[3:])
        T = pose.make(R, centre + step[:3] - R @ centre) @ T
        if not limit and float(np.abs(step[:3]).max()) < 1e-9:
            break
    r = r + J @ step
    in_plane = p[rows] - np.sum(p[rows] * planes, axis=1, keepdims=True) * planes
    covariance = _sandwich(J, weight * r, in_plane, face[rows], H, scale)
    count = {name: int(np.count_nonzero(face[rows] == k)) for k, name in enumerate(names)}
    offset = {name: float(np.mean(r[face[rows] == k])) for k, name in enumerate(names) if count[name]}
    residual = float(np.sqrt(np.average(r * r, weights=np.maximum(weight, 1e-12))))
    if ball_radius_m is None:
        _check_ball(offset, where)
    _check_scale(offset, part, where)
    _check_residual(residual, offset, where)
    return Registration(T, covariance, centre, names, count, offset, residual, condition)


def _check_count(points: int, names: Sequence[str], where: str) -> None:
    if points < LEAST_POINTS:
        raise InputError(
            "hardly a point of the scan lies on the datum faces",
            where=where,
            value=f"{points} on {', '.join(names)}",
            limit=f">= {LEAST_POINTS}",
            hint="Scan the faces that the program does not machine too, or choose others: --datum",
        )


def _check_residual(residual: float, offset: Mapping[str, float], where: str) -> None:
    if residual > LARGEST_RESIDUAL_M:
        raise InputError(
            "the datum faces of the scan do not fit those of the blank",
            where=where,
            value=f"residual {residual / MM:.3f} mm; " + ", ".join(f"{k} {v / MM:+.3f} mm" for k, v in offset.items()),
            limit=f"<= {LARGEST_RESIDUAL_M / MM:g} mm",
            hint="Is the blank of the cell file this one? Choose faces that fit with --datum",
        )


def _icp(points: Float, part: NominalPart, T_start: Float, names: tuple[str, ...]) -> Float:
    """ICP of the points near the datum faces, on samples of these."""
    import small_gicp  # heavy

    pitch = max(1.0 * MM, float(np.sqrt(part.area_m2 / 40_000)))
    samples = np.concatenate([part.faces.samples(name, pitch) for name in names])
    if len(samples) < 10:
        return T_start
    moved = pose.transform(T_start, points)
    target = small_gicp.PointCloud(samples / MM)
    tree = small_gicp.KdTree(target)
    small_gicp.estimate_normals(target, tree, num_neighbors=9)
    near = np.zeros(len(moved), np.bool_)
    for name in names:
        normal, distance = part.faces.plane(name)
        near |= (np.abs(moved @ normal - distance) < _LIMITS_M[0]) & part.faces.on(name, moved)
    if near.sum() < 10:
        return T_start
    chosen = moved[near][:: max(1, int(near.sum()) // 40_000)]
    source = small_gicp.PointCloud(chosen / MM)
    T = np.eye(4)
    for reach in (3.0, 1.5):
        result: Any = small_gicp.align(
            target,
            source,
            tree,
            init_T_target_source=T,
            registration_type="PLANE_ICP",
            max_correspondence_distance=reach,
            max_iterations=40,
            translation_epsilon=1e-5,
            rotation_epsilon=1e-7,
        )
        T = np.asarray(result.T_target_source, np.float64).copy()
    T[:3, 3] *= MM
    step = np.linalg.norm(T[:3, 3] + (T[:3, :3] - np.eye(3)) @ (0.5 * (part.faces.low + part.faces.high)))
    return T_start if step > 10.0 * MM else T @ T_start  # freedoms that the faces leave open run away; told later


def _on_faces(
    p: Float,
    normals: Float,
    part: NominalPart,
    names: tuple[str, ...],
    gate: Float,
    middle: Float,
    ball_radius_m: float,
) -> tuple[Int, Float]:
    """Face that each point is on, -1 for none, and its distance from that plane."""
    # On a face are points within its `gate` of its `middle`, the distance that its points have from the plane.
    face = np.full(len(p), -1)
    nearest = np.full(len(p), np.inf)
    for k, name in enumerate(names):
        normal, distance = part.faces.plane(name)
        off = p @ normal - distance - ball_radius_m
        known: Bool = np.asarray(np.isfinite(normals).all(axis=1), np.bool_)
        facing: Bool = ~known | np.asarray(np.abs(np.where(known[:, None], normals, 0.0) @ normal) > _ALIGNED)
        rows = np.flatnonzero((np.abs(off - middle[k]) < gate[k]) & (np.abs(off) < np.abs(nearest)) & facing)
        rows = rows[part.faces.on(name, p[rows])]
        face[rows], nearest[rows] = k, off[rows]
    return face, nearest


def _information(J: Float, weight: Float, part: NominalPart, names: tuple[str, ...], where: str) -> tuple[Float, float]:
    """Normal matrix and its condition; refuses freedoms that it leaves open."""
    H = (J * weight[:, None]).T @ J
    length = np.array([1.0, 1.0, 1.0, *[2.0 / part.diagonal_m] * 3])
    values, vectors = np.linalg.eigh(H * np.outer(length, length))
    open_: Bool = np.asarray(values < LEAST_EIGENVALUE * values[-1])
    if open_.any():
        share = np.sum(vectors[:, open_] ** 2, axis=1)
        free = [name for name, part_of in zip(FREEDOMS, share, strict=True) if part_of > 0.3]
        raise InputError(
            f"the datum faces leave {int(open_.sum())} of six freedoms open",
            where=where,
            value=f"{', '.join(names)}: {', '.join(free)}",
            limit="faces that look in three directions, all of them scanned",
            hint="Scan more faces of the blank, choose others with --datum, or give the pose: --aligned",
        )
    return H, float(values[-1] / values[0])


def _sandwich(J: Float, wr: Float, p: Float, face: Int, H: Float, scale: float) -> Float:
    """Covariance of the pose from residuals added up in patches."""
    cell = np.rint(p / _PATCH_M).astype(np.int64)  # 0 across the plane, whatever its rounding
    _, patch = np.unique(np.column_stack([face, cell]), axis=0, return_inverse=True)
    patch = patch.ravel()
    patches = int(patch.max()) + 1
    inverse: Float = np.linalg.inv(H).astype(np.float64)
    white: Float = inverse * scale * scale
    if patches < 12:
        return white
    sums = np.stack([np.bincount(patch, J[:, k] * wr, patches) for k in range(6)], axis=1)
    sandwich: Float = inverse @ (sums.T @ sums) @ inverse * (patches / (patches - 6.0))
    return sandwich


def _check_ball(offset: dict[str, float], where: str) -> None:
    """Refuse points of which opposite faces are too far apart by the same in two or three directions."""
    halves = np.array([0.5 * (offset[a] + offset[b]) for a, b in _OPPOSITE if a in offset and b in offset])
    if len(halves) < 2:
        return
    mean = float(halves.mean())
    if abs(mean) > BALL_M and float(np.abs(halves - mean).max()) < _ALIKE * abs(mean):
        raise ball_error(mean, where)


def _check_scale(offset: dict[str, float], part: NominalPart, where: str) -> None:
    """Refuse a scan that is larger or smaller in two or three directions alike."""
    size = part.faces.high - part.faces.low
    scales = [
        (offset[a] + offset[b]) / float(size[k]) for k, (a, b) in enumerate(_OPPOSITE) if a in offset and b in offset
    ]
    if len(scales) < 2:
        return
    mean = float(np.mean(scales))
    if abs(mean) > SCALE and max(scales) - min(scales) < 0.5 * abs(mean):
        raise InputError(
            "the scale of the scan is wrong",
            where=where,
            value=f"{1.0 + mean:.5f} times the size of the blank in {len(scales)} directions",
            limit=f"1 within {SCALE:g}",
            hint="Calibrate the scanner, or export without a shrinkage factor",
        )


def _medians(r: Float, face: Int, count: int) -> Float:
    """Median (count,) of the residuals on each face, 0 where it has none."""
    return np.array([np.median(r[face == k]) if np.any(face == k) else 0.0 for k in range(count)])
