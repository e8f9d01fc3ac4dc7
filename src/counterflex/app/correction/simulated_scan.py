"""A scan of a simulated part: places sampled as a scanner does, with noise; never the exact surface."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.app.proof.judge import Judged
from counterflex.core.arrays import Bool, Float, Float32
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.part_deviations import FLOOR, WALL, PartDeviations
from counterflex.evaluate.surface import NominalSurface

NOISE_M: Final = 20.0 * UM
"""Standard deviation of a single place: structured light."""
PITCH_M: Final = 0.5 * MM
"""Mean distance of places on floors; walls are sampled as finely as the nominal surface has points on them."""


def simulated_scan(
    surface: NominalSurface | None, judged: Judged, *, seed: int, noise_m: float = NOISE_M, pitch_m: float = PITCH_M
) -> PartDeviations:
    """Scan a simulated part.

    Args:
        surface: Nominal surface.
        judged: The part.
        seed: Of the places and the noise.
        noise_m: Standard deviation of the noise, independent from place to place.
        pitch_m: Mean distance of places on floors.

    Returns:
        Deviations in the axes of the path; rows in no order of the path, as a scanner's.

    Raises:
        InputError: The tool turns in the cut.
    """
    rng = np.random.default_rng(seed)
    if surface is None or judged.surface is None:
        raise InputError(
            "the tool turns in the cut, and such a simulated part has no surface to scan yet",
            hint="Programs with one direction of the tool are corrected",
        )
    floor, wall = judged.surface.floor_m, judged.surface.wall_m
    known: Bool = np.isfinite(floor)
    known &= rng.random(floor.shape) < (surface.nominal.cell_m / pitch_m) ** 2
    j, i = np.nonzero(known)
    nominal = surface.nominal
    at = np.stack([nominal.x0_m + i * nominal.cell_m, nominal.y0_m + j * nominal.cell_m, nominal.z[j, i]], axis=1)
    on = np.isfinite(wall)
    out = np.pad(-surface.wall_normal[on], ((0, 0), (0, 1)))
    points = np.concatenate([at, surface.wall_point[on]])
    normals = np.concatenate([_upward(surface, floor)[j, i], out])
    deviation = np.concatenate([floor[j, i].astype(np.float64), wall[on]])
    face = np.concatenate([np.full(len(at), FLOOR), np.full(len(out), WALL)])
    order = rng.permutation(len(points))
    noisy = deviation + noise_m * rng.standard_normal(len(points))
    sigma = np.full(len(points), noise_m)
    return PartDeviations(points[order], normals[order], noisy[order], sigma, face[order])


def _upward(surface: NominalSurface, floor: Float32) -> Float:
    """(ny, nx, 3) unit normals of the nominal floors, out of the material."""
    z = np.where(np.isfinite(floor), surface.nominal.z.astype(np.float64), np.nan)
    slope = [np.nan_to_num(np.gradient(z, surface.nominal.cell_m, axis=axis)) for axis in (1, 0)]
    normal = np.stack([-slope[0], -slope[1], np.ones_like(z)], axis=-1)
    out: Float = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return out
