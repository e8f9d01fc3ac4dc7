"""Values of features on parts that can be measured: rows of a table, floors, heights of maps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import UM
from counterflex.cutting.stock import HeightMap
from counterflex.evaluate.surface import NominalSurface

OWN_FLOOR_M = 50.0 * UM
"""A level floor that is further from the tip was made by another cut."""


class MeasurablePart(Protocol):
    """A part whose walls and floors can be found."""

    def exits(self, point: Float, direction: Float) -> Float:
        """Return how far the cut reaches along rays.

        Args:
            point: (m, 3) m, in the cut, part frame.
            direction: (m, 2) horizontal unit vectors, towards the wall.

        Returns:
            (m,) m; nan or infinite where no wall is found.
        """

    def heights(self, xy: Float) -> Float:
        """Height of the floor at places (n, 2) m, part frame, filtered (:mod:`~counterflex.evaluate.floor_filter`).

        Returns:
            (n,) m; nan where it is not known.
        """


Row = tuple[str, float, float, dict[str, float], dict[str, float], dict[str, float]]
"""Quantity, nominal value, size for the general tolerance; by variant worst value, mean value and share of places."""


def values_row(
    quantity: str, nominal: float, size: float, values: Mapping[str, Float], shares: Mapping[str, float] | None = None
) -> Row:
    """Worst and mean of the values of each variant; shares of places where the values are of the whole feature."""
    worst, mean, share = {}, {}, dict(shares or {})
    for name, value in values.items():
        known = value[np.isfinite(value)]
        share.setdefault(name, len(known) / max(len(value), 1))
        if len(known):
            worst[name] = float(known[np.argmax(np.abs(known - nominal))])
            mean[name] = float(known.mean())
    return quantity, nominal, size, worst, mean, share


def flatness(place: Float, surface: NominalSurface, parts: Mapping[str, MeasurablePart], side: float) -> list[Row]:
    """Flatness over floor that no shifted wall can stand on; no row where there is too little of it."""
    clear = np.isinf(surface.rise_m) & np.isinf(surface.fall_m) & surface.floor
    j, i, on = cells(surface.nominal, place)
    inner = place[on & clear[j, i]]
    if len(inner) < 10:
        return []
    base = height_at(surface.nominal, inner)
    A = np.column_stack([inner - inner.mean(axis=0), np.ones(len(inner))])
    zone, shares = {}, {}
    for name, part in parts.items():
        deviation = part.heights(inner) - base
        known = np.isfinite(deviation)
        shares[name] = float(known.mean())
        if known.sum() < 10:
            continue
        plane = np.linalg.lstsq(A[known], deviation[known], rcond=None)[0]
        zone[name] = np.array([float(np.ptp(deviation[known] - A[known] @ plane))])
    return [values_row("flatness", 0.0, side, zone, shares)]


def cells(part: HeightMap, xy: Float) -> tuple[Int, Int, Bool]:
    """Row and column of the cell under each place, clipped to the map, and whether the place is on it."""
    i = np.round((xy[:, 0] - part.x0_m) / part.cell_m).astype(np.int64)
    j = np.round((xy[:, 1] - part.y0_m) / part.cell_m).astype(np.int64)
    ny, nx = part.z.shape
    on: Bool = (i >= 0) & (j >= 0) & (i < nx) & (j < ny)
    return np.clip(j, 0, ny - 1), np.clip(i, 0, nx - 1), on


def height_at(part: HeightMap, xy: Float) -> Float:
    """Height of the cell under each place, (n,) m; NaN off the map."""
    j, i, on = cells(part, xy)
    out: Float = np.where(on, part.z[j, i].astype(np.float64), np.nan)
    return out
