"""Measure the faces of a CAD solid on scanned parts: each machined face that was scanned becomes a feature."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM
from counterflex.evaluate.features import FORM, SIZES, ZONES, FeatureRow, flatness_k, linear_m
from counterflex.evaluate.floor_filter import LocalFit, floor_fit, local_fit
from counterflex.evaluate.inspection.mesh_shape import CadFace, CadSolid
from counterflex.evaluate.inspection.nominal_part import STEEP
from counterflex.evaluate.inspection.part_deviations import FREE
from counterflex.evaluate.inspection.scanned_part import UP, ScannedPart
from counterflex.evaluate.iso230.circular_test import Circularity
from counterflex.evaluate.measured_values import Row, values_row

PITCH_M: Final = 1.0 * MM
"""Distance of the places of a face at which it is measured; up a wall three times as much, as its windows are."""
_MOST: Final = 4000
_EDGE_M: Final = 0.5 * MM  # Strip along the edges of a face that is left out; of a narrow one what leaves its middle
_MIDDLE: Final = 0.8
_ROUND: Final = 0.5  # Less of a turn than this share is measured as a profile: its centre is known badly
_LEAST: Final = 3
_FLAT: Final = 10  # Fewer places show no form
_LARGEST_M: Final = 2.0  # End of the table of general tolerances


@dataclass(frozen=True, eq=False)
class _Places:
    """Places of one face, or of the faces of one cylinder."""

    face: CadFace
    members: tuple[int, ...]
    points: Float  # (m, 3) m
    normals: Float  # (m, 3)
    turn: float = 0.0  # share of a turn that a cylinder has
    bore: bool = False  # the material lies about the cylinder

    def rows(self, values: Mapping[str, Float]) -> list[Row]:
        """Rows by the deviations (m,) of the places, by part."""
        face, points = self.face, self.points
        shares = {name: float(np.isfinite(value).mean()) for name, value in values.items()}
        side = float(np.ptp(points, axis=0).max())
        rows: list[Row] = []
        if face.kind == "plane":
            at = float(face.axis @ face.point)
            rows.append(values_row("position", at, abs(at), {name: at + value for name, value in values.items()}))
            flat = {name: _flatness(face, points, value) for name, value in values.items() if _enough(value)}
            rows.append(values_row("flatness", 0.0, side, flat, shares))
            if "orientation" in face.limits:
                zone = {name: np.array([np.nanmax(value) - np.nanmin(value)]) for name, value in values.items()}
                rows.append(values_row("orientation", 0.0, side, zone, shares))
        elif face.kind == "cylinder" and self.turn >= _ROUND:
            rows += _circle(self, values, shares)
        if "profile" in face.limits or not rows:
            rows.append(values_row("profile", 0.0, side, values))
        return rows


class CadFeatures:
    """Faces of a solid as features of parts: a measurement that :func:`.with_uncertainty` repeats."""

    def __init__(
        self, solid: CadSolid, source: str, tolerances_m: Mapping[tuple[str, str], float] | None = None
    ) -> None:
        """Prepare the places.

        Args:
            source: Name of the CAD file.
            tolerances_m: (feature, quantity) to +- tolerance, m, for what the file has no tolerance of.
        """
        self._solid, self._source, self._given = solid, source, tolerances_m or {}
        self._places = [self._places_of(members) for members in _joined(solid.faces)]
        self._fits: dict[int, tuple[ScannedPart, list[tuple[Int, LocalFit] | None]]] = {}

    def __call__(self, parts: Mapping[str, ScannedPart]) -> tuple[FeatureRow, ...]:
        """Rows of every face that one of the parts shows."""
        out = []
        for k, places in enumerate(self._places):
            values = {}
            for name, part in parts.items():
                fit = self._fits_of(part)[k]
                if fit is not None:
                    values[name] = fit[1].values(part.rows.deviation_m[fit[0]])
            if values:
                out += [self._row(places, row) for row in places.rows(values) if row[3]]
        return tuple(out)

    def drawn(self, left: Callable[[Float, Float], Float]) -> tuple[tuple[FeatureRow, ...], tuple[str, ...]]:
        """Rows of the faces on many parts, by number, and the names of faces that the program does not make.

        Args:
            left: Gives the material left, (m, parts) m, at places (m, 3) with outward normals; nan where none was made.
        """
        out: list[FeatureRow] = []
        untouched = []
        for places in self._places:
            values = left(places.points, places.normals)
            if np.isfinite(values).any(axis=1).sum() < _LEAST:
                untouched.append(places.face.name)
                continue
            out += [self._row(places, row) for row in places.rows({str(k): v for k, v in enumerate(values.T)})]
        return tuple(out), tuple(untouched)

    def place_sigma_m(self, part: ScannedPart, feature: str) -> float:
        """Standard deviation of a place of a face by the noise of the scan alone, median, m."""
        for places, fit in zip(self._places, self._fits_of(part), strict=True):
            if places.face.name == feature and fit is not None:
                sigma = fit[1].standard_deviation(part.noise_m / np.sqrt(part.count[fit[0]]))
                return float(np.nanmedian(sigma))
        return 0.0

    def _fits_of(self, part: ScannedPart) -> list[tuple[Int, LocalFit] | None]:
        """Rows and weights by face; of a part moved, scaled or drawn again those of the part itself."""
        key = id(part.rows.points)
        if key not in self._fits:
            rows = np.flatnonzero(part.rows.face != FREE)
            owner = self._solid.face_of(part.rows.points[rows], part.rows.normals[rows])
            self._fits[key] = part, [_fit(places, rows, owner, part) for places in self._places]
        return self._fits[key][1]

    def _row(self, places: _Places, row: Row) -> FeatureRow:
        face = places.face
        quantity, nominal, size, worst, mean, share = row
        stated = face.limits.get(quantity)
        if stated is not None:
            nominal, tolerance, by = nominal if stated[0] is None else stated[0], stated[1], f"PMI of {self._source}"
        elif (face.name, quantity) in self._given:
            tolerance, by = self._given[face.name, quantity], "given"
        elif quantity in ZONES:
            tolerance, by = flatness_k(size), FORM
        else:
            tolerance, by = linear_m(min(size, _LARGEST_M)), SIZES
        grows = not (quantity == "diameter" and places.bore)
        return FeatureRow(face.name, quantity, nominal, worst, mean, tolerance, by, measured_share=share, grows=grows)

    def _places_of(self, members: tuple[int, ...]) -> _Places:
        face, solid = self._solid.faces[members[0]], self._solid
        triangles = solid.triangles[np.isin(solid.owner, members)]
        corners = solid.vertices[triangles]
        if face.kind == "cylinder":
            points, normals, turn = _ring(face, corners)
            return _Places(face, members, points, normals, turn, _is_bore(face, corners))
        points, normals = even_points(corners)
        steep = float(np.median(np.abs(normals[:, 2]))) < STEEP
        scale = np.array([1.0, 1.0, 1.0 / UP if steep else 1.0])
        off = scipy.spatial.cKDTree(_edges(solid.vertices, triangles) * scale).query(points * scale)[0]
        # a wall is as narrow as it is high at a place
        column = np.unique(np.floor(points[:, :2] / PITCH_M), axis=0, return_inverse=True)[1].ravel() * steep
        most = np.zeros(len(off))
        np.maximum.at(most, column, off)
        inner = off >= np.minimum(_EDGE_M, _MIDDLE * most[column])
        points, normals = points[inner], normals[inner]
        _, first = np.unique(np.floor(points * scale / pitch_of(corners)).astype(np.int64), axis=0, return_index=True)
        return _Places(face, members, points[first], normals[first])


def _joined(faces: tuple[CadFace, ...]) -> list[tuple[int, ...]]:
    """Numbers of faces by feature: those on one cylinder are one."""
    groups: dict[tuple[float, ...], list[int]] = {}
    for k, face in enumerate(faces):
        key: tuple[float, ...] = (float(k),)
        if face.kind == "cylinder":
            axis = face.axis * np.sign(face.axis[np.argmax(np.abs(face.axis))])
            foot = face.point - axis * (axis @ face.point)
            key = (-1.0, *np.round(np.concatenate([axis, foot / MM, [face.radius_m / MM]]), 4).tolist())
        groups.setdefault(key, []).append(k)
    return [tuple(group) for group in groups.values()]


def _sizes(corners: Float) -> tuple[Float, Float]:
    """Unit normals (t, 3) and areas (t,) of triangles (t, 3, 3)."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(across, axis=1)
    return across / np.maximum(double, 1e-300)[:, None], 0.5 * double


def pitch_of(corners: Float) -> float:
    """Distance of places on a face from its triangles (t, 3, 3), m: some thousands on a large one."""
    return max(PITCH_M, float(np.sqrt(_sizes(corners)[1].sum() / _MOST)))


def even_points(corners: Float) -> tuple[Float, Float]:
    """Points (n, 3) m evenly all over triangles (t, 3, 3), about ten to a square of a pitch, and their normals.

    Source: Roberts 2018, "The unreasonable effectiveness of quasirandom sequences", for the place in a triangle.
    """
    normals, area = _sizes(corners)
    total = np.cumsum(area)
    k = np.arange(max(200, int(10.0 * total[-1] / pitch_of(corners) ** 2)))
    owner = np.minimum(np.searchsorted(total, (k + 0.5) / len(k) * total[-1]), len(area) - 1)
    u, v = (0.7548776662466927 * k) % 1.0, (0.5698402909980532 * k) % 1.0
    folded = u + v > 1.0
    u, v = np.where(folded, 1.0 - u, u), np.where(folded, 1.0 - v, v)
    return np.einsum("nc,ncd->nd", np.stack([1.0 - u - v, u, v], axis=1), corners[owner]), normals[owner]


def _edges(vertices: Float, triangles: Int) -> Float:
    """Points along the edges of a face, which one triangle only has, (n, 3) m."""
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    pairs, count = np.unique(pairs, axis=0, return_counts=True)
    ends = vertices[pairs[count == 1]]
    number = np.maximum(2, np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / (0.2 * PITCH_M))).astype(np.int64)
    owner = np.repeat(np.arange(len(ends)), number)
    along = (np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)) / (number[owner] - 1.0)
    out: Float = ends[owner, 0] + along[:, None] * (ends[owner, 1] - ends[owner, 0])
    return out


def _ring(face: CadFace, corners: Float) -> tuple[Float, Float, float]:
    """Places on a cylinder half way along it, every 2 deg, their normals, and the share of a turn."""
    R = face.frame
    local = (corners - face.point) @ R
    angle = np.arctan2(local[..., 1], local[..., 0])
    from_first = (angle - angle[:, :1] + np.pi) % (2.0 * np.pi) - np.pi
    span = np.linspace(0.0, 1.0, 9)
    low, high = from_first.min(axis=1), from_first.max(axis=1)
    degrees = np.degrees(angle[:, :1] + low[:, None] + span * (high - low)[:, None]) % 360.0
    bins, member = np.unique(np.floor(degrees / 2.0).astype(np.int64).ravel(), return_inverse=True)
    bottom, top = np.full(len(bins), np.inf), np.full(len(bins), -np.inf)
    np.minimum.at(bottom, member, np.repeat(local[..., 2].min(axis=1), len(span)))
    np.maximum.at(top, member, np.repeat(local[..., 2].max(axis=1), len(span)))
    middle = np.radians(2.0 * bins + 1.0)
    away = np.column_stack([np.cos(middle), np.sin(middle), np.zeros(len(bins))])
    at = face.radius_m * away + np.column_stack([np.zeros((len(bins), 2)), 0.5 * (bottom + top)])
    sign = -1.0 if _is_bore(face, corners) else 1.0
    return face.point + at @ R.T, sign * away @ R.T, len(bins) / 180.0


def _is_bore(face: CadFace, corners: Float) -> bool:
    away = corners.mean(axis=1) - face.point
    away -= np.outer(away @ face.axis, face.axis)
    return float(np.median(np.einsum("nk,nk->n", _sizes(corners)[0], away))) < 0.0


def _fit(places: _Places, rows: Int, owner: Int, part: ScannedPart) -> tuple[Int, LocalFit] | None:
    """Rows of a part on a face and their weights at its places; None where it shows too little of the face."""
    own = rows[np.isin(owner, places.members)]
    if len(own) < _LEAST or len(places.points) == 0:
        return None
    points, face = part.rows.points[own], places.face
    if face.kind != "cylinder" and float(np.median(places.normals[:, 2])) > STEEP:
        R = face.frame[:, :2] if face.kind == "plane" else np.eye(3)[:, :2]
        fit = floor_fit(points @ R, places.points @ R, part.pitch_m)
    else:
        # a wall: along the feed it may bend, along the tool windows are longer
        R = face.frame if face.kind == "cylinder" else np.eye(3)
        narrow = np.array([1.0, 1.0, 1.0 / UP])
        normal = places.normals @ R
        along = np.column_stack([-normal[:, 1], normal[:, 0], np.zeros(len(normal))])
        along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
        across = np.stack([along, np.cross(normal, along)], axis=2)
        fit = local_fit(points @ R * narrow, places.points @ R * narrow, 0.75 * part.window_m, across, curved=True)
    return (own, fit) if int(fit.known.sum()) >= _LEAST else None


def _enough(value: Float) -> bool:
    """Return whether places are known at which a face may be off its best plane."""
    return int(np.isfinite(value).sum()) >= _FLAT


def _flatness(face: CadFace, points: Float, value: Float) -> Float:
    """Zone of the deviations after their best plane is taken out, (1,) m."""
    known = np.isfinite(value)
    A = np.column_stack([((points - points.mean(axis=0)) @ face.frame[:, :2])[known], np.ones(known.sum())])
    left = value[known] - A @ np.linalg.lstsq(A, value[known], rcond=None)[0]
    return np.array([float(np.ptp(left))])


def _circle(places: _Places, values: Mapping[str, Float], shares: Mapping[str, float]) -> list[Row]:
    """Diameter, roundness and centre of a cylinder half way along it."""
    face, R = places.face, places.face.frame
    diameter, roundness, centre = {}, {}, {}
    for name, value in values.items():
        known = np.isfinite(value)
        if known.sum() < 0.5 * _ROUND * len(known):
            continue
        made = (places.points - face.point)[known] + value[known, None] * places.normals[known]
        circle = Circularity.of((made @ R)[:, :2], np.zeros(2), face.radius_m)
        diameter[name] = np.array([2.0 * circle.radius_m])
        roundness[name] = np.array([circle.g_m])
        centre[name] = np.array([float(np.hypot(*circle.centre_offset_m))])
    size = 2.0 * face.radius_m
    return [
        values_row("diameter", size, size, diameter, shares),
        values_row("roundness", 0.0, size, roundness, shares),
        values_row("centre", 0.0, face.radius_m, centre, shares),
    ]
