"""Maps over the working space: predicted deflection of a program, stiffness, first natural frequency."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from counterflex import __version__
from counterflex.app.inputs import AS_IT_IS, Reading
from counterflex.app.placement.placement import frame_of, task_of
from counterflex.app.placement.region import Wish
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import DEG, MM, UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import write_summary
from counterflex.plan.lowest_mode import mode_of
from counterflex.plan.placement.candidate import Site, judge, site_of
from counterflex.plan.placement.search import PlacementBounds
from counterflex.plan.posture.cut_path import Surface
from counterflex.plan.posture.survey import RobotHere
from counterflex.report.data import Head
from counterflex.report.glossary import MODEL_NOTE, MODEL_UM
from counterflex.report.page import render
from counterflex.robot.elasticity.compliance import cartesian_compliance

_VIEWS: Final = {"level": ("x_mm", "y_mm", "x of the base, mm", "y of the base, mm"),
                 "upright": ("x_mm", "z_mm", "x of the base, mm", "height of the part frame, mm")}  # fmt: skip
_FIGURES: Final = {
    "deflection_um": ("Deflection by the program", "um"),
    "stiffness_n_per_um": ("Stiffness in the softest direction", "N/um"),
    "first_mode_hz": ("First natural frequency", "Hz"),
}
"""Title and unit."""


def _grid(at: Mapping[tuple[Any, Any], Mapping[str, Any]], x: list[Any], y: list[Any], key: str, missing: Any) -> Any:
    """Values by place, a row for each of y."""
    return [[at[a, b][key] if (a, b) in at else missing for a in x] for b in y]


def map_figure(rows: Sequence[Mapping[str, Any]], present: Mapping[str, Any], view: str, key: str) -> dict[str, Any]:
    """One map: places that are refused stay white; a cross marks the present place."""
    u, v, x_title, y_title = _VIEWS[view]
    at = {(row[u], row[v]): row for row in rows if row["view"] == view}
    x, y = sorted({a for a, _ in at}), sorted({b for _, b in at})
    z = _grid(at, x, y, key, None)
    known = np.array([value for row in z for value in row if value is not None], dtype=np.float64)
    high = float(np.percentile(known, 95.0)) if len(known) else 1.0
    unit = _FIGURES[key][1]
    refused = _grid(at, x, y, "refused", "")
    data = [
        {
            "type": "heatmap", "x": x, "y": y, "z": z, "text": refused, "colorscale": "Viridis",
            "zmin": float(known.min()) if len(known) else 0.0, "zmax": high, "colorbar": {"title": {"text": unit}},
            "hovertemplate": f"%{{x:.0f}}, %{{y:.0f}} mm: %{{z:.3g}} {unit} %{{text}}<extra></extra>",
            "hoverongaps": True,
        },
        {
            "type": "scatter", "mode": "markers", "x": [present[u]], "y": [present[v]], "name": "present place",
            "marker": {"symbol": "x", "size": 13, "color": "#b91c1c"}, "hoverinfo": "name",
        },
    ]  # fmt: skip
    layout = {
        "height": 460,
        "margin": {"l": 64, "r": 12, "t": 16, "b": 48},
        "showlegend": False,
        "xaxis": {"title": {"text": x_title}, "zeroline": False, "constrain": "domain"},
        "yaxis": {"title": {"text": y_title}, "zeroline": False, "scaleanchor": "x", "constrain": "domain"},
    }
    return {"data": data, "layout": layout}


TABLE: Final = "map.csv"
POINTS: Final = 21
VIEWS: Final = {"level": ("x_mm", "y_mm"), "upright": ("x_mm", "z_mm")}
"""Level: at the present height of the part. Upright: at the present y of the middle of the program."""
FIGURES: Final = ("deflection_um", "stiffness_n_per_um", "first_mode_hz")


class PlacementMap(Summary):
    """Working space of a cell for a program."""

    def _shown(self) -> Parts:
        best = {"present": self["present"], **{f"best, {view}": row for view, row in self["best"].items()}}
        rows = [defaultdict(lambda: None, row or {}, place=name) for name, row in best.items()]
        columns = "place | x mm:g | y mm:g | z mm:g | {}=deflection_um:g | softest N/um=stiffness_n_per_um:g | "
        columns = columns.format(MODEL_UM) + "first mode Hz=first_mode_hz:g | margin deg:g"
        note = f"Deflection without compensation. {MODEL_NOTE}"
        yield ShownTable.of(self.line("{program} on {cell}"), columns, rows, note)
        yield self.line("{places} places, {refused} of them refused")

    def page(self, rows: Sequence[Mapping[str, Any]]) -> str:
        """The page, as HTML text; rows of ``map.csv``."""
        figures, listed = {}, []
        for key, (title, unit) in _FIGURES.items():
            for view in _VIEWS:
                name = f"{key}_{view}"
                figures[name] = map_figure(rows, self["present"], view, key)
                place = "at the present height" if view == "level" else "at the present y"
                listed.append({"name": name, "title": f"{title}, {unit}, {place}"})
        best = self["best"]["level"]
        present = self["present"]["deflection_um"]
        verdict = "The program can be run in no place of the map."
        if best is not None:
            verdict = f"Least deflection by the model at this height: {best['deflection_um']:g} um"
            verdict += f" at x {best['x_mm']:g}, y {best['y_mm']:g} mm"
            verdict += "." if present is None else f"; {present:g} um in the present place."
        head = Head(f"Working space: {self['program']}", f"{self['cell']}, {self['robot']}")
        return render("placement_map.html.j2", figures, [], data=head, summary=self, verdict=verdict, listed=listed)


def run(
    program: str | Path,
    cell_file: str | Path,
    out: str | Path,
    *,
    reading: Reading = AS_IT_IS,
    surface: Surface = "both",
    wish: Wish | None = None,
    points: int = POINTS,
    progress: Progress = silent,
) -> PlacementMap:
    """Write ``map.csv``, ``report.html`` and ``summary.json`` into ``out``: all or none.

    Args:
        wish: Where the part may stand; its rotation stays the present one.
        points: Places along each axis of a map.
    """
    begin = time.perf_counter()
    cell = read_cell(cell_file)
    job, cell, task = task_of(program, cell, reading, surface)
    site, frame = site_of(task), frame_of(task, cell)
    if cell.tables.external_axes and (wish is None or wish.box_mm is None):
        raise InputError(
            "in a cell with external axes the part stays where it is clamped, so that a map needs a region",
            where=cell.label,
            value="no --region",
            hint="Give --region X0,X1,Y0,Y1,Z0,Z1; the axes stand where the cell file has them",
        )
    region, here = (Wish() if wish is None else wish).region(frame), frame.here
    rows = []
    places = _places(region, here, points)
    for k, (view, place) in enumerate(places):
        rows.append(_row(view, place, site, site.robot.facing(frame.seen(place).T_base_standing), cell))
        progress((k + 1) / len(places))
    own = _row("present", here, site, site.robot, cell)
    summary = {
        "program": job.program.name,
        "cell": cell.label,
        "robot": cell.robot.name,
        "surface": surface,
        "present": {key: value for key, value in own.items() if key != "view"},
        "best": {view: _best(rows, view) for view in VIEWS},
        "places": len(rows),
        "refused": sum(bool(row["refused"]) for row in rows),
        "seconds": round(time.perf_counter() - begin, 3),
        "counterflex": __version__,
    }
    with atomic.atomic_folder(out) as staging:
        from counterflex.report.page import write_page

        atomic.write_text(staging / TABLE, pl.DataFrame(rows, infer_schema_length=None).write_csv())
        write_summary(staging / "summary.json", summary)
        result = PlacementMap(summary)
        write_page(result.page(rows), staging / "report.html")
    return result


def _places(region: PlacementBounds, here: Float, points: int) -> list[tuple[str, Float]]:
    """(4,) places of both maps, rotation 0; a map has its second axis slowest."""
    low, high = np.array(region.low), np.array(region.high)
    out = []
    for view, second in (("level", 1), ("upright", 2)):
        for v in np.linspace(low[second], high[second], points):
            for u in np.linspace(low[0], high[0], points):
                place = here.copy()
                place[0], place[second] = u, v
                out.append((view, place))
    return out


def _row(view: str, place: Float, site: Site, robot: RobotHere, cell: Cell) -> dict[str, Any]:
    """One place in shop units; figures are missing where it is refused."""
    judged = judge(site, robot.T_base_standing)
    row: dict[str, Any] = {"view": view}
    row |= {key: round(float(v) / MM, 1) for key, v in zip(("x_mm", "y_mm", "z_mm"), place, strict=False)}
    row |= {"refused": judged.refused, **dict.fromkeys((*FIGURES, "margin_deg")), "branch": judged.branch}
    if judged.q is None:
        return row
    q = judged.q[len(judged.q) // 2]
    C = robot.relative_motion(q[None]).compliance(cartesian_compliance(cell.chain, q))[0]
    soft = float(np.linalg.eigvalsh(C[:3, :3])[-1])
    return row | {
        "deflection_um": round(judged.deflection_m / UM, 2),
        "stiffness_n_per_um": round(UM / soft, 4) if soft > 0.0 else None,
        "first_mode_hz": round(mode_of(cell.chain, q, cell.tables.dynamics.mode).hz, 3),
        "margin_deg": round(judged.margin_rad / DEG, 2),
    }


def _best(rows: list[dict[str, Any]], view: str) -> dict[str, Any] | None:
    """The place of a map where the program bends the robot least."""
    own = [row for row in rows if row["view"] == view and not row["refused"]]
    return min(own, key=lambda row: float(row["deflection_um"]), default=None)
