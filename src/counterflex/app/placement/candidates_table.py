"""All candidates of a search as a table in shop units."""

from __future__ import annotations

import csv
import io

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell
from counterflex.plan.placement.candidate import Candidate, pareto
from counterflex.plan.placement.search import JudgedPlacements

WORTH = ("deflection_um", "error_um", "damping_in_cut", "time_s", "margin_deg", "clearance_mm")


def values_of(judged: JudgedPlacements) -> Float:
    """(n, 4) error, time, margin to joint limits and singularities, clearance of coarse bodies; each to be small."""
    rows = [[c.error_m, c.time_s, -c.margin_rad, -min(c.clearance_m, 1e3)] for c in judged.candidates]
    out = np.array(rows).reshape(-1, 4)
    out[[bool(c.refused) for c in judged.candidates]] = np.inf
    return out


def table_of(judged: JudgedPlacements, cell: Cell) -> str:
    """CSV, one candidate a row, in the order in which they were judged."""
    axes = cell.tables.external_axes
    text, front = io.StringIO(), set(pareto(values_of(judged)).tolist())
    rows = csv.writer(text, lineterminator="\n")
    head = ["x_mm", "y_mm", "z_mm", "turned_deg"]
    head += [f"{axis.name}_{'mm' if axis.kind == 'linear' else 'deg'}" for axis in axes]
    rows.writerow([*head, "refused", "reached_percent", *WORTH, "branch", "rotation_about_tool_deg", "pareto"])
    units = np.array([MM, MM, MM, DEG, *(MM if axis.kind == "linear" else DEG for axis in axes)])
    for k, (place, c) in enumerate(zip(judged.places, judged.candidates, strict=True)):
        x, y, z, *turns = (place / units).tolist()
        first = [f"{x:.1f}", f"{y:.1f}", f"{z:.1f}", *(f"{v:.2f}" for v in turns)]
        rows.writerow([*first, c.refused, f"{100.0 * c.passed:.1f}", *_worth(c), "yes" if k in front else ""])
    return text.getvalue()


def _worth(c: Candidate) -> list[str]:
    """Columns of a candidate that can be reached; empty otherwise."""
    if c.q is None:
        return [""] * (len(WORTH) + 2)
    return [
        f"{c.deflection_m / UM:.2f}",
        f"{c.error_m / UM:.2f}",
        "" if np.isnan(c.least_damping) else f"{c.least_damping:.4f}",
        f"{c.time_s:.2f}",
        f"{c.margin_rad / DEG:.2f}",
        "" if np.isinf(c.clearance_m) else f"{c.clearance_m / MM:.1f}",
        c.branch,
        f"{c.rotation_rad / DEG:g}",
    ]
