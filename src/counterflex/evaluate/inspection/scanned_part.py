"""A registered scan as a part that can be measured: deviations, map, walls and floors at any place."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Float32, Int
from counterflex.core.units import MM, UM
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.figures import DeviationFigures
from counterflex.evaluate.floor_filter import LocalFit, floor_fit, local_fit
from counterflex.evaluate.inspection.cloud import Cloud
from counterflex.evaluate.inspection.nominal_part import FACING, NominalPart
from counterflex.evaluate.inspection.part_deviations import FLOOR, WALL, PartDeviations
from counterflex.evaluate.inspection.registration import Registration
from counterflex.evaluate.measured_values import height_at
from counterflex.evaluate.surface import SurfaceDeviation
from counterflex.evaluate.swept_section import SweptSection, swept_section
from counterflex.geometry import pose

WANTED_M: Final = 3.0 * UM
"""Noise that is wanted of a value at a place: the window about it is as wide as that needs, within limits."""
_WIDEST_M: Final = 1.5 * MM
UP: Final = 3.0
"""Up and down a wall the window is so many times wider: what a tool leaves changes along its path first."""
_NEAR: Final = 8
_GROSS: Final = 8.0
_SCANNED: Final = 500  # Fewer points were probed one by one: their neighbours do not show which way the surface looks


@dataclass(frozen=True, eq=False)
class ScannedPart:
    """A scan against the nominal part."""

    part: NominalPart  # what was to be made
    registration: Registration  # where the scan lies on it
    rows: PartDeviations  # deviations, one for each point of the thinned scan that lies on a face
    p_part_tcp: Float  # (n, 3) m, the undisturbed path of the tool, part frame
    count: Int  # (n,) of each row, how many measured points it is the mean of
    noise_m: float  # standard deviation of one measured point
    unmatched_share: float  # points of the scan that are of no surface of the part within reach
    left_out: Float  # (k, 3) m, points of the thinned scan that count for no face, part frame
    # (n, 2) m, radius and corner radius of the tool at each row of the path; None: one tool
    nominal_outline: Float | None = None
    # weights of places that were asked for before
    fits: dict[bytes, LocalFit] = field(default_factory=dict, repr=False)

    @cached_property
    def _floors(self) -> Int:
        return np.flatnonzero(self.rows.face == FLOOR)

    @cached_property
    def _walls(self) -> Int:
        return np.flatnonzero(self.rows.face == WALL)

    @cached_property
    def _nominal_section(self) -> SweptSection:
        cutter = self.part.surface.cutter
        outline = cutter if self.nominal_outline is None else self.nominal_outline
        return swept_section(self.p_part_tcp, outline, cutter.radius_m + self.part.surface.reach_m)

    def shifted(self, step: Float) -> ScannedPart:
        """The same scan lying elsewhere by a small shift and turn (6,) about the centre: m, rad.

        Deviations change by first order; the measured places stay.
        """
        change = self.registration.sensitivity(self.rows.points, self.rows.normals) @ step
        return replace(self, rows=replace(self.rows, deviation_m=self.rows.deviation_m + change))

    def scaled(self, scale: float) -> ScannedPart:
        """The same scan larger by a share, about the centre of the part."""
        away = np.einsum("nk,nk->n", self.rows.points - self.registration.centre, self.rows.normals)
        return replace(self, rows=replace(self.rows, deviation_m=self.rows.deviation_m + scale * away))

    def redrawn(self, rng: np.random.Generator) -> ScannedPart:
        """The same scan with its noise once more; the noise of the pose, which all points have in common, is not."""
        noise = rng.standard_normal(len(self.rows)) * self.noise_m / np.sqrt(self.count)
        return replace(self, rows=replace(self.rows, deviation_m=self.rows.deviation_m + noise))

    def exits(self, point: Float, direction: Float) -> Float:
        """See :class:`~counterflex.evaluate.features.MeasurablePart`: nominal exit less what was left on the wall.

        The deviation there is that of a plane through the measured points about the nominal wall point.
        """
        nominal, normal = self._nominal_section.wall_exit(point, direction, 0.0)
        at = np.where(np.isfinite(nominal), nominal, 0.0)
        place = point.copy()
        place[:, :2] += at[:, None] * direction
        along = np.column_stack([-normal[:, 1], normal[:, 0], np.zeros(len(point))])
        across = np.stack([along, np.tile([0.0, 0.0, 1.0], (len(point), 1))], axis=2)
        fit = self._fit(b"wall", place, across)
        deviation = fit.values(self.rows.deviation_m[self._walls])
        slant = np.sum(normal * direction, axis=1)
        out: Float = nominal - deviation / np.where(np.abs(slant) > 0.1, slant, np.nan)
        return out

    def heights(self, xy: Float) -> Float:
        """See :class:`~counterflex.evaluate.features.MeasurablePart`: nominal height and filtered rise of the floor."""
        fit = self._fit(b"floor", xy, None)
        rise = self.rows.deviation_m[self._floors] / self.rows.normals[self._floors, 2]
        out: Float = height_at(self.part.surface.nominal, xy) + fit.values(rise)
        return out

    def place_sigma_m(self) -> float:
        """Standard deviation of a wall or floor place by the noise of the scan alone, median of all asked for, m."""
        sigma = np.full(len(self.rows), self.noise_m) / np.sqrt(self.count)
        values = []
        for key, fit in self.fits.items():
            rows = self._walls if key.startswith(b"wall") else self._floors
            some = fit.standard_deviation(sigma[rows])
            values.append(some[np.isfinite(some)])
        every = np.concatenate(values) if values else np.empty(0)
        return float(np.median(every)) if len(every) else 0.0

    def _fit(self, kind: bytes, places: Float, across: Float | None) -> LocalFit:
        key = kind + np.ascontiguousarray(places).tobytes()
        if key not in self.fits:
            if across is None:
                self.fits[key] = floor_fit(self.rows.points[self._floors, :2], places, self.pitch_m)
            else:
                narrow = np.array([1.0, 1.0, 1.0 / UP])
                self.fits[key] = local_fit(
                    self.rows.points[self._walls] * narrow, places * narrow, 0.75 * self.window_m, across, curved=True
                )
        return self.fits[key]

    def surface_deviation(self) -> SurfaceDeviation:
        """The map: floors by cells of three pitches of the scan, walls at the nominal wall points."""
        surface = self.part.surface
        nominal = surface.nominal
        pitch = max(3.0 * self.pitch_m, nominal.cell_m)
        step = max(1, round(pitch / nominal.cell_m))
        floor = _cell_means(
            self.rows.points[self._floors], self.rows.deviation_m[self._floors], surface.floor, nominal, step
        )
        wall = self._wall_means()
        cells = floor[~np.isnan(floor)].astype(np.float64)
        area = np.full(len(cells), nominal.cell_m**2)
        known = ~np.isnan(wall)
        return SurfaceDeviation(
            floor_m=floor,
            wall_m=wall,
            surface=DeviationFigures.weighted(
                np.concatenate([cells, wall[known]]), np.concatenate([area, surface.wall_area_m2[known]])
            ),
            floor=DeviationFigures.weighted(cells, area),
            wall=DeviationFigures.weighted(wall[known], surface.wall_area_m2[known]),
            floor_resolution_m=step * nominal.cell_m,
            wall_resolution_m=pitch,
            wall_lost_m2=float(surface.wall_area_m2[~known].sum()),
        )

    @cached_property
    def pitch_m(self) -> float:
        """Distance of the points of the thinned scan: root of the area that each stands for, m."""
        if len(self.rows) < _NEAR + 1:
            return 1.0 * MM
        points = self.rows.points[:: max(1, len(self.rows) // 2000)]
        radius = scipy.spatial.cKDTree(self.rows.points).query(points, k=_NEAR + 1)[0][:, -1]
        return float(np.median(radius)) * float(np.sqrt(np.pi / _NEAR))

    @cached_property
    def window_m(self) -> float:
        """Radius about a place within which a plane is laid through the measured points, m.

        ``n = 2 (noise / 3 um)^2`` measured points give the wanted noise; at least three pitches, at most 1.5 mm. Along
        a wall it is three quarters of that.
        """
        per_area = float(np.mean(self.count)) / self.pitch_m**2 if len(self.rows) else 1.0
        needed = 2.0 * (self.noise_m / WANTED_M) ** 2
        return float(np.clip(np.sqrt(needed / (np.pi * per_area)), 3.0 * self.pitch_m, _WIDEST_M))

    def _wall_means(self) -> Float:
        """Mean deviation of the measured points about each nominal wall point."""
        surface = self.part.surface
        out = np.full(len(surface.wall_point), np.nan)
        if len(self._walls) == 0 or len(out) == 0:
            return out
        tree = scipy.spatial.cKDTree(self.rows.points[self._walls])
        k = min(12, len(self._walls))
        reach = max(2.0 * self.pitch_m, 0.5 * MM)
        distance, near = tree.query(surface.wall_point, k=k, distance_upper_bound=reach)
        distance, near = distance.reshape(len(out), k), near.reshape(len(out), k)
        near_by = np.isfinite(distance)
        rows = self._walls[np.where(near_by, near, 0)]
        facing = -np.einsum("mkd,md->mk", self.rows.normals[rows][:, :, :2], surface.wall_normal)
        near_by &= facing > FACING
        count = near_by.sum(axis=1)
        total = np.where(near_by, self.rows.deviation_m[rows], 0.0).sum(axis=1)
        out[count > 0] = total[count > 0] / count[count > 0]
        return out


def _cell_means(points: Float, deviation: Float, floor: Bool, grid: HeightMap, step: int) -> Float32:
    """Mean deviation in squares of ``step`` cells, written into each of their floor cells."""
    ny, nx = floor.shape
    x0, y0, cell = grid.x0_m, grid.y0_m, grid.cell_m
    my, mx = -(-ny // step), -(-nx // step)
    i = np.clip(np.rint((points[:, 0] - x0) / cell), 0, nx - 1).astype(np.int64) // step
    j = np.clip(np.rint((points[:, 1] - y0) / cell), 0, ny - 1).astype(np.int64) // step
    place = j * mx + i
    count = np.bincount(place, minlength=my * mx)
    total = np.bincount(place, deviation, my * mx)
    mean = np.divide(total, count, out=np.full(my * mx, np.nan), where=count > 0).reshape(my, mx)
    wide = np.repeat(np.repeat(mean, step, axis=0), step, axis=1)[:ny, :nx]
    out: Float32 = np.where(floor, wide, np.nan).astype(np.float32)
    return out


def scanned_part(
    cloud: Cloud,
    part: NominalPart,
    registration: Registration,
    p_part_tcp: Float,
    ball_radius_m: float = 0.0,
    nominal_outline: Float | None = None,
) -> ScannedPart:
    """The deviations of a registered scan.

    A point counts for the nearest face of the nominal part whose normal agrees with that of the scan within 30 deg; at
    edges, where it agrees with none, it is left out. Its standard deviation is that of the measured points (the
    scatter about a plane through the neighbours), by the root of their number, and that by the pose.

    Args:
        cloud: The scan, m, its own frame.
        registration: Where the scan lies on it.
        p_part_tcp: (n, 3) m, the undisturbed path, part frame.
        ball_radius_m: Where the points are centres of a probe's ball: its radius, m.
        nominal_outline: (n, 2) m, radius and corner radius of the tool at each row of the path; None: one tool.
    """
    points = pose.transform(registration.T_part_scan, cloud.points)
    normals = cloud.normals @ registration.T_part_scan[:3, :3].T
    nearest = part.nearest(points, normals if len(cloud) > _SCANNED else None, ball_radius_m)
    on = np.isfinite(nearest.deviation_m)
    n = nearest.normals[on]
    deviation = nearest.deviation_m[on]
    foot = points[on] - deviation[:, None] * n
    deviation = deviation - ball_radius_m
    noise = _noise(foot, n, deviation, cloud.count[on])
    agreeing = _agreeing(foot, deviation, noise)
    rows_of = np.flatnonzero(on)[agreeing]
    foot, n, deviation = foot[agreeing], n[agreeing], deviation[agreeing]
    by_pose = registration.standard_deviation_m(foot, n)
    sigma = np.sqrt(noise**2 / cloud.count[rows_of] + by_pose**2)
    rows = PartDeviations(foot, n, deviation, sigma, nearest.face[rows_of].astype(np.int64))
    unmatched = 1.0 - float(np.mean(nearest.near))
    count, left_out = cloud.count[rows_of], np.delete(points, rows_of, axis=0)
    return ScannedPart(part, registration, rows, p_part_tcp, count, noise, unmatched, left_out, nominal_outline)


def _agreeing(foot: Float, deviation: Float, noise: float) -> Bool:
    """Mark points that agree with their neighbours: off from the median of eight by at most eight times the noise."""
    if len(foot) < 50 or noise == 0.0:
        return np.ones(len(foot), np.bool_)
    _, near = scipy.spatial.cKDTree(foot).query(foot, k=_NEAR + 1)
    out: Bool = np.abs(deviation - np.median(deviation[near], axis=1)) <= _GROSS * noise + 20.0 * UM
    return out


def _noise(foot: Float, normals: Float, deviation: Float, count: Int) -> float:
    """Standard deviation of one measured point: scatter of neighbours on one face, robust."""
    if len(foot) < 50:
        return 0.0
    some = np.linspace(0, len(foot) - 1, min(4000, len(foot))).astype(np.int64)
    _, near = scipy.spatial.cKDTree(foot).query(foot[some], k=9)
    same = np.einsum("mkd,md->mk", normals[near], normals[some]) > 0.99
    whole = same.all(axis=1)
    if whole.sum() < 20:
        return 0.0
    near, some = near[whole], some[whole]
    step = foot[near] - foot[some][:, None]
    # of nine values about a plane six are free
    A = np.concatenate([np.ones((*near.shape, 1)), step / MM], axis=2)
    solution = np.einsum("mik,mk->mi", np.linalg.pinv(A, rcond=1e-3), deviation[near])
    left = deviation[near] - np.einsum("mki,mi->mk", A, solution)
    raw = np.sqrt(np.sum(left**2 * count[near], axis=1) / 6.0)
    return max(float(np.median(raw)), 0.1 * UM)
