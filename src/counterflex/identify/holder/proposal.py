"""Loads (and places of the bridges) from which a spindle holder's sensitivities are seen best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import DEG, MM
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import greedy
from counterflex.identify.holder.residuals import DRAWING_SHARE, parameters, readings
from counterflex.identify.recipe import Proposal
from counterflex.sensing.strain_holder import Gauge, HolderBeam, StrainHolder, sight, tool_matrix


def holder_before(cell: CellModel) -> StrainHolder:
    """The holder before identification.

    Raises InputError: the cell has none. Raises ModelError: what the cell holds as its holder is none.
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
    p = np.array([g.p_holder_gauge for g in candidates])
    search = _GaugeSearch(
        K / np.sqrt(np.mean(K**2)),
        S[:, 3:] / np.sqrt(np.mean(S[:, 3:] ** 2)),
        np.linalg.norm(p[:, None] - p[None], axis=2) >= SPACING_M,
    )
    chosen: list[int] = []
    while len(chosen) < count:
        chosen.append(search.best_addition(chosen))
    value = search.score(chosen)
    while True:
        for k in range(count):
            rest = chosen[:k] + chosen[k + 1 :]
            chosen = [*rest[:k], search.best_addition(rest), *rest[k:]]
        new = search.score(chosen)
        if new <= value + 1e-9:
            return tuple(candidates[i] for i in chosen)
        value = new


@dataclass(frozen=True, eq=False)
class _GaugeSearch:
    """Candidate bridges: strain by force and by moment, scaled to 1, and pairs that are far enough apart."""

    forces: Float
    moments: Float
    far_enough: Bool

    def score(self, rows: list[int]) -> float:
        K, M = self.forces[rows], self.moments[rows]
        force, rest = np.linalg.slogdet(K.T @ K + 1e-6 * np.eye(3))[1], np.linalg.slogdet(M.T @ M + np.eye(3))[1]
        return float(force + 1e-3 * rest)

    def best_addition(self, rows: list[int]) -> int:
        free = np.flatnonzero(np.all(self.far_enough[:, rows], axis=1)) if rows else np.arange(len(self.forces))
        return int(max(free, key=lambda i: self.score([*rows, int(i)])))


LARGEST_N = 300.0
"""Largest load: low enough for spindle bearings (Denkena2015 section 4)."""
SHORTER_M = 60.0 * MM
FORCE_N = 0.5
AVERAGED = 500


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Choose loads, and with ``gauges = "choose"`` the places of the bridges as well.

    Loads of ``largest_n`` in 17 directions (never pulling the tool out of the spindle), at the tool tip and
    ``shorter_m`` nearer the spindle: two points make the effect of the tool's length visible. Greedy, D-optimal.

    ``count``: Loads, at least 6. ``settings``: ``gauges`` (``given`` or ``choose``), ``largest_n``, ``shorter_m``.
    Raises InputError: fewer than 6, or a cell without such a holder.
    """
    if count < 6:
        raise InputError("loads to propose", value=count, limit=">= 6 (15 or more for a check)")
    holder = holder_before(cell)
    how = str(settings.get("gauges", "given"))
    if how not in ("given", "choose"):
        raise InputError("setting gauges", value=how, limit="given or choose")
    if how == "choose":
        factor = float(np.median([g.factor for g in holder.gauges]))
        gauges = choose_gauges(holder.beam, holder.p_holder_tcp, len(holder.gauges), factor=factor)
        holder = StrainHolder.designed(
            holder.beam, gauges, holder.p_holder_tcp, float(holder.noise.mean()), holder.segment
        )
    largest, shorter = float(settings.get("largest_n", LARGEST_N)), float(settings.get("shorter_m", SHORTER_M))
    loads = _loads(holder, largest, shorter)
    copies = -(-count // len(loads))
    loads = np.tile(loads, (copies, 1))
    sigma = holder.noise / np.sqrt(AVERAGED)
    data = of_arrays(
        "loads",
        "holder_loads",
        {"strain": np.zeros((len(loads), len(sigma))), "f_tcp_holder": loads[:, :3], "p_holder_load": loads[:, 3:]},
        {"strain": sigma, "f_tcp_holder": FORCE_N},
    )
    free = parameters(holder, DRAWING_SHARE, temperature=False, drift=False)
    mask, block = free.free, readings(data, holder, reference_c=holder.reference_c)
    J = block.jacobian(free.nominal)[:, :, mask] * free.slope(free.nominal)[mask]
    rows, covariance = greedy(J, count)
    rows = rows[np.lexsort((-np.abs(loads[rows, 2]), loads[rows, 5]))]
    sd = np.sqrt(np.diag(covariance)) * free.slope(free.nominal)[mask]
    seen = sight(tool_matrix(holder.sensitivity, holder.p_holder_tcp), np.diag(holder.noise**2))
    names = ("fx_n", "fy_n", "fz_n", "px_m", "py_m", "pz_m")
    listed = "; ".join(
        f"{1e3 * g.p_holder_gauge[0]:.1f} {1e3 * g.p_holder_gauge[1]:.1f} {1e3 * g.p_holder_gauge[2]:.1f} mm at "
        f"{g.angle_rad / DEG:.0f} deg"
        for g in holder.gauges
    )
    return Proposal(
        recipe="holder",
        kind="holder_loads",
        columns={name: loads[rows, i] for i, name in enumerate(names)},
        expected=dict(zip([p.name for p, f in zip(free, mask, strict=True) if f], (float(v) for v in sd), strict=True)),
        units=free.units,
        remarks=(
            f"Bridges at x y z: {listed}",
            "The standard deviation of one sample is then "
            + ", ".join(f"{a} {v:.1f} N" for a, v in zip("xyz", seen.sigma_n, strict=True))
            + f" (one standard deviation; condition {seen.condition:.1f})",
            "Press with a tool dummy against a dynamometer, go back to no load after each load, and read both there: "
            "the difference is drift and hysteresis",
            f"Loads reach {largest:g} N; check that against the spindle bearings",
        ),
        settings={"gauges": [float(v) for g in holder.gauges for v in (*g.p_holder_gauge, g.angle_rad, g.factor)]},
    )


def _loads(holder: StrainHolder, largest_n: float, shorter_m: float) -> Float:
    """(n, 6) forces and where they act."""
    directions = [np.array(d) for d in product((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), (-1.0, 0.0)) if any(d)]
    tip = holder.p_holder_tcp
    points = [tip, tip - np.array([0.0, 0.0, shorter_m])]
    return np.array(
        [[*(share * largest_n * d / np.linalg.norm(d)), *p] for p in points for d in directions for share in (1.0, 0.5)]
    )
