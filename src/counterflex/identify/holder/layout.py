"""The instrumented spindle holder of a cell, and where to glue its bridges: D-optimal among places on its cheeks."""

from __future__ import annotations

from itertools import product

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import DEG, MM
from counterflex.identify.data.model import CellModel
from counterflex.sensing.holder_beam import Gauge, HolderBeam
from counterflex.sensing.strain_holder import StrainHolder, tool_matrix


def holder_before(cell: CellModel) -> StrainHolder:
    """The holder before identification.

    Raises:
        InputError: The cell has none.
        ModelError: What the cell holds as its holder is none.
    """
    table = cell.tables.get("holder")
    if table is None:
        raise InputError(
            "the cell has no instrumented spindle holder",
            where=cell.name,
            hint="Add a table [holder] with its dimensions, [[holder.gauges]] and tcp_mm to the cell file",
        )
    if not isinstance(table, StrainHolder):
        raise ModelError("the holder of the cell is not a holder", value=type(table).__name__)
    return table


SPACING_M = 12.0 * MM
"""Least distance between two bridges."""
_STATIONS = (0.12, 0.25, 0.38, 0.5, 0.62, 0.75, 0.88)
_ACROSS = (-0.4, -0.2, 0.0, 0.2, 0.4)
_ANGLES = (0.0, 45.0 * DEG, -45.0 * DEG)


def places(beam: HolderBeam, factor: float) -> tuple[Gauge, ...]:
    """Candidates: faces of both cheeks, inner and outer, along the cheek and at 45 deg; edges along it.

    ``factor``: By which a notch raises the strain.
    """
    half, t, b, L = 0.5 * beam.distance_m, 0.5 * beam.thickness_m, 0.5 * beam.width_m, beam.length_m
    out = [
        Gauge((side * half + face * t, across * 2.0 * b, station * L), angle, factor)
        for side, face, across, station, angle in product((-1.0, 1.0), (-1.0, 1.0), _ACROSS, _STATIONS, _ANGLES)
    ]
    out += [
        Gauge((side * half, edge * b, station * L), 0.0, factor)
        for side, edge, station in product((-1.0, 1.0), (-1.0, 1.0), _STATIONS)
    ]
    return tuple(out)


def choose_gauges(
    beam: HolderBeam, p_holder_tcp: Float, count: int = 6, *, factor: float = 2.0, largest_n: Float | float = 1.0
) -> tuple[Gauge, ...]:
    """The places whose strains tell the force at the tool best.

    Starts greedily and exchanges one bridge after the other while ``det(K^T K)`` grows; ties of a whole plane are
    broken by what the bridges tell about moments, so that other tool lengths are seen as well.

    Args:
        beam: The holder.
        p_holder_tcp: (3,) m tool tip.
        count: Bridges, 3 to 12.
        factor: By which a notch raises the strain.
        largest_n: Weight of each force direction; one or (3,).

    Raises:
        InputError: Fewer than 3 or more than 12.
    """
    if not 3 <= count <= 12:
        raise InputError("bridges of the holder", value=count, limit="3..12")
    candidates = places(beam, factor)
    S = beam.sensitivity(candidates)
    K = tool_matrix(S, p_holder_tcp) * np.broadcast_to(np.asarray(largest_n, dtype=np.float64), (3,))
    K = K / np.sqrt(np.mean(K**2))
    moments = S[:, 3:] / np.sqrt(np.mean(S[:, 3:] ** 2))
    p = np.array([g.p_holder_gauge for g in candidates])
    far_enough = np.linalg.norm(p[:, None] - p[None], axis=2) >= SPACING_M

    def score(rows: list[int]) -> float:
        forces = np.linalg.slogdet(K[rows].T @ K[rows] + 1e-6 * np.eye(3))[1]
        rest = np.linalg.slogdet(moments[rows].T @ moments[rows] + np.eye(3))[1]
        return float(forces + 1e-3 * rest)

    def best_addition(rows: list[int]) -> int:
        free = np.flatnonzero(np.all(far_enough[:, rows], axis=1)) if rows else np.arange(len(candidates))
        return int(max(free, key=lambda i: score([*rows, int(i)])))

    chosen: list[int] = []
    while len(chosen) < count:
        chosen.append(best_addition(chosen))
    value = score(chosen)
    while True:
        for k in range(count):
            rest = chosen[:k] + chosen[k + 1 :]
            chosen = [*rest[:k], best_addition(rest), *rest[k:]]
        new = score(chosen)
        if new <= value + 1e-9:
            return tuple(candidates[i] for i in chosen)
        value = new
