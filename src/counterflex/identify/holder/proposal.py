"""Loads (and places of the bridges) from which a spindle holder's sensitivities are seen best."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.greedy import greedy
from counterflex.identify.holder.layout import choose_gauges, holder_before
from counterflex.identify.holder.residuals import DRAWING_SHARE, parameters, readings
from counterflex.identify.recipe import Proposal
from counterflex.sensing.strain_holder import StrainHolder, sight, tool_matrix

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

    Raises:
        InputError: Fewer than 6, or a cell without such a holder.
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
        settings={
            "gauges": [float(v) for g in holder.gauges for v in (*g.p_holder_gauge, g.angle_rad, g.factor)],
        },
    )


def _loads(holder: StrainHolder, largest_n: float, shorter_m: float) -> Float:
    """(n, 6) forces and where they act."""
    directions = [np.array(d) for d in product((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), (-1.0, 0.0)) if any(d)]
    tip = holder.p_holder_tcp
    points = [tip, tip - np.array([0.0, 0.0, shorter_m])]
    return np.array(
        [[*(share * largest_n * d / np.linalg.norm(d)), *p] for p in points for d in directions for share in (1.0, 0.5)]
    )
