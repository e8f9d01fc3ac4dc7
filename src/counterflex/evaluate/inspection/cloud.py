"""A cloud of measured points made small: means of small cubes, lone points left out, normals by their neighbours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Float32, Int, batches
from counterflex.core.errors import InputError
from counterflex.core.units import MM

ALONE: Final = 0.25
"""A place with fewer neighbours than this share of the median is taken for an outlier."""
NEIGHBOURS: Final = 16
"""Points that a normal is estimated from."""
_HALF: Final = 1 << 20  # Cubes on each side of the origin: 21 bits each way
_ROWS: Final = 4_000_000


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a part, some thousand to some million."""

    points: Float  # (n, 3) m, means of the measured points in cubes of side `pitch_m`
    count: Int  # (n,) how many measured points each stands for
    normals: Float  # (n, 3) unit normals of the surface by the neighbours, of either sign; nan where there are too few
    pitch_m: float  # side of the cubes
    outliers: int  # how many measured points were left out as lone ones

    def __len__(self) -> int:
        """Number of points."""
        return len(self.points)


def thinned(chunks: Iterable[Float32], unit_m: float, pitch_m: float) -> Cloud:
    """Replace the points in each small cube by their mean, and leave out lone ones.

    Args:
        chunks: (k, 3) each, in file units.
        unit_m: SI value of a file unit.
        pitch_m: Side of the cubes, m.

    Raises:
        InputError: Too few points are left.
    """
    sums, counts = _cubes(chunks, unit_m, pitch_m)
    points = sums / counts[:, None]
    kept = crowded(points, pitch_m)
    outliers = int(counts[~kept].sum())
    points, counts = points[kept], counts[kept]
    if len(points) < NEIGHBOURS:
        raise InputError("the scan has too few points", value=len(points), limit=f">= {NEIGHBOURS}, outliers left out")
    return Cloud(points, counts, _normals(points), pitch_m, outliers)


def _cubes(chunks: Iterable[Float32], unit_m: float, pitch_m: float) -> tuple[Float, Int]:
    """Sums of coordinates (m) and numbers of points by cube; what is too far off to be of the part is left out."""
    keys: list[Int] = []
    values: list[Float] = []
    rows = 0
    for chunk in chunks:
        for some in batches(len(chunk), 1 << 20):
            points = chunk[some].astype(np.float64) * unit_m
            place = np.floor(points / pitch_m)
            near = np.abs(place).max(axis=1) < _HALF
            cube = place[near].astype(np.int64) + _HALF
            key = (cube[:, 0] << 42) | (cube[:, 1] << 21) | cube[:, 2]
            key, value = _merged(key, np.column_stack([points[near], np.ones(len(key))]))
            keys.append(key)
            values.append(value)
            rows += len(key)
            if rows > _ROWS:
                key, value = _merged(np.concatenate(keys), np.concatenate(values))
                keys, values, rows = [key], [value], len(key) // 2
    key, value = _merged(np.concatenate(keys), np.concatenate(values))
    return value[:, :3], value[:, 3].astype(np.int64)


def _merged(key: Int, value: Float) -> tuple[Int, Float]:
    """Rows of one key added up."""
    if len(key) == 0:
        return key, value
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    return key[first], np.add.reduceat(value[order], first, axis=0)


def crowded(points: Float, pitch: float) -> Bool:
    """Mark points (n, 3) that have neighbours like the others; all of a cloud too thin to tell.

    The neighbours of a point are the points in its cube and in the 26 about it; the side of the cubes is five times
    the distance of the points, or the pitch if that is larger. Any unit.
    """
    if len(points) < 1000:
        return np.ones(len(points), np.bool_)
    low, high = np.percentile(points, [5.0, 95.0], axis=0)
    size = np.sort(high - low)[::-1]
    distance = float(np.sqrt(2.0 * size[0] * size[1] / len(points)))
    side = 5.0 * max(pitch, distance, float(size[0]) / 1e5)
    place = np.clip(np.floor((points - low) / side), 2 - _HALF, _HALF - 2).astype(np.int64) + _HALF
    key = (place[:, 0] << 42) | (place[:, 1] << 21) | place[:, 2]
    cubes, cube, number = np.unique(key, return_inverse=True, return_counts=True)
    around = np.zeros(len(cubes), np.int64)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            for dz in (-1, 0, 1):
                other = cubes + ((dx << 42) + (dy << 21) + dz)
                at = np.minimum(np.searchsorted(cubes, other), len(cubes) - 1)
                around += np.where(cubes[at] == other, number[at], 0)
    neighbours = around[cube]
    out: Bool = neighbours >= max(4.0, ALONE * _on_surface(neighbours))
    return out


def _on_surface(neighbours: Int) -> float:
    """Neighbours of a point of the surface: the median, each point weighing as the square of how many it has."""
    # Where a million outliers fill the space about four hundred thousand points of a part, the plain median is theirs.
    number = np.sort(neighbours)
    weight = np.cumsum(number.astype(np.float64) ** 2)
    return float(number[np.searchsorted(weight, 0.5 * weight[-1])])


def _normals(points: Float) -> Float:
    """Unit normals by the neighbours."""
    import small_gicp  # heavy

    cloud = small_gicp.PointCloud(points - points.mean(axis=0))
    small_gicp.estimate_normals(cloud, num_neighbors=min(NEIGHBOURS, len(points)))
    normals = np.asarray(cloud.normals(), np.float64)[:, :3].copy()
    length = np.linalg.norm(normals, axis=1)
    normals[length < 0.5] = np.nan
    return normals


LEAST: Final = 0.55
MOST: Final = 1.4
"""A scan of a part is this much of the diagonal of its blank: parts of it may be missing, a little beside it caught."""
WIDEST: Final = 12.0
"""A scan of a part on a table: beyond this the part is too few of its points to be found."""


def diagonal(sample: Float, where: str) -> float:
    """Diagonal of the box about a cloud of points, along its principal axes; outliers left out.

    Args:
        sample: (n, 3) in any unit.

    Raises:
        InputError: All points are in one place.
    """
    points = sample[crowded(sample, 0.0)]
    centred = points - np.median(points, axis=0)
    axes = np.linalg.svd(centred[:: max(1, len(centred) // 20_000)], full_matrices=False)[2]
    size = np.ptp(np.percentile(centred @ axes.T, [0.2, 99.8], axis=0), axis=0)
    out = float(np.linalg.norm(size))
    if not out > 0.0:
        raise InputError("all points of the scan are in one place", where=where)
    return out


@dataclass(frozen=True)
class ScanUnit:
    """Units that a scan may be in."""

    # names with SI values: one where the extent of the scan is that of the blank; where the scan is larger in all
    # units, those in which much may have been scanned beside the part
    choices: tuple[tuple[str, float], ...]
    fault: InputError | None = None  # raised where the part lies in the scan in none of them; None: its extent fits

    @classmethod
    def of(
        cls, sample: Float, blank_m: float, units_m: Mapping[str, float], stated: str | None, where: str
    ) -> ScanUnit:
        """Units that a scan may be in.

        Args:
            sample: (n, 3) points in file units.
            blank_m: Diagonal of the blank, m.
            units_m: SI values of the units to choose from, by name.
            stated: Name of the unit that was asked for or that the file states, or None.

        Raises:
            InputError: The extent of the scan does not fit the blank in the stated unit, or in none.
        """
        size = diagonal(sample, where)
        ratio = {name: size * unit / blank_m for name, unit in units_m.items()}
        fits = [name for name in units_m if LEAST <= ratio[name] <= MOST]
        if stated is None and len(fits) == 1:
            return cls(((fits[0], units_m[fits[0]]),))
        if stated is not None and LEAST <= ratio[stated] <= MOST:
            return cls(((stated, units_m[stated]),))
        fault = _other_size(size, blank_m, units_m, stated, fits, where)
        wide = [name for name in units_m if MOST < ratio[name] <= WIDEST and stated in (None, name)]
        if not wide or (fits and stated is None):
            raise fault
        return cls(tuple((name, units_m[name]) for name in wide), fault)


def _other_size(
    size: float, blank_m: float, units_m: Mapping[str, float], stated: str | None, fits: list[str], where: str
) -> InputError:
    limit = f"about {blank_m / MM:.4g} mm, the diagonal of the blank ({LEAST:g} to {MOST:g} times it)"
    remedy = "Cut away what was scanned beside it, or give its pose: --datum-points"
    if stated is not None:
        other = f"In {fits[0]} it would fit: give --unit {fits[0]}" if fits else "It fits in no unit: is it this part?"
        return InputError(
            f"the scan is of another size than the blank, if its unit is {stated}",
            where=where,
            value=f"{size * units_m[stated] / MM:.4g} mm across",
            limit=limit,
            hint=other + ("" if fits else f" {remedy}"),
        )
    return InputError(
        "the scan does not fit the blank in any unit",
        where=where,
        value=", ".join(f"{size * unit / MM:.4g} mm across in {name}" for name, unit in units_m.items()),
        limit=limit,
        hint=f"Is it a scan of this part? {remedy}; or give --unit",
    )
