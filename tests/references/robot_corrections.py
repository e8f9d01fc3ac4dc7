"""Corrections along a program, and distances from polylines, for the tests of programs changed in place."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.program import Program


def corrected(program: Program, size_m: float, waves: float, turn_rad: float = 0.0) -> CompensatedPath:
    """A correction that grows from nothing behind the first motion and swings along the path."""
    path = tool_path(program, step_m=0.5 * MM)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    share = way / max(way[-1], 1e-9)
    shape = np.sin(0.5 * np.pi * np.minimum(1.0, share * 4.0)) * (1.0 + 0.5 * np.sin(waves * share))
    shape[path.motion == 0] = 0.0
    correction = size_m * shape[:, None] * np.array([0.3, 1.0, 0.6])
    return CompensatedPath.from_correction(path, correction, turn_rad * shape[:, None] * np.array([1.0, 0.4, 0.0]))


def gap_to_polyline(points: Float, line: Float) -> float:
    """Largest distance of points from a polyline."""
    a, b = line[:-1], line[1:]
    step = b - a
    length2 = np.maximum(np.sum(step * step, axis=1), 1e-30)
    share = np.clip(np.einsum("pij,ij->pi", points[:, None] - a[None], step) / length2, 0.0, 1.0)
    near = a[None] + share[..., None] * step[None]
    return float(np.linalg.norm(points[:, None] - near, axis=2).min(axis=1).max())
