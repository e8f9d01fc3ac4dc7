"""Tables and page of the reproduction of Mandiola2023."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.mandiola_case import RUN_IN_DEG, VARIANTS, Case
from counterflex.core.units import DEG, MS
from counterflex.evaluate import tracking
from counterflex.files.cell import read_cell
from counterflex.files.cell_online import OnlineTable, tracker_plant
from counterflex.report.tracking_page import TrackedRun, TrackingData, tracking_page
from counterflex.runtime.settings import OnlineSettings
from counterflex.runtime.tracker_design import (
    Margins,
    TrackerGains,
    grid,
    margins,
    margins_of,
    observer_response,
)

COLUMNS: Final = (
    "seed",
    "controller",
    "where",
    "contour rms um",
    "contour max um",
    "total rms um",
    "total max um",
    "orientation max mdeg",
)
MARGIN_COLUMNS: Final = (
    "controller",
    "Ki per cycle",
    "Kp",
    "crossover Hz",
    "phase margin deg",
    "gain margin dB",
    "Ms",
)
STRETCHES: Final = (
    ("circle", "turn", "circle"),
    ("circle", "reversals", "after reversals"),
    ("square", "straights", "straights"),
    ("square", "corners", "corners"),
)
_OBSERVER: Final = OnlineTable(force="none", tracker="observer")


def margin_table(cell_file: Path) -> list[dict[str, Any]]:
    """Margins of the published gain, of the designed one and of the observer, on the robot of a cell file."""
    cell = read_cell(cell_file)
    table = cell.tables.online or _OBSERVER
    mode = cell.tables.lowest_mode
    chosen: OnlineSettings = table.settings(cell.tables.timing, compensated=False, mode=mode)
    plant = tracker_plant(chosen.delays, chosen.period_s, mode)
    tuning = chosen.tuning
    designed = TrackerGains(tuning.gain, tuning.proportional, tuning.notch)
    f = grid(chosen.period_s)
    usual = _OBSERVER.settings(None, compensated=False).tuning
    drift = usual.drift_m**2 * chosen.period_s
    seen = observer_response(plant, drift, usual.noise_m**2, f) * plant.response(f)
    rows: list[tuple[str, float | None, float | None, Margins]] = [
        ("published", 0.01, 0.0, margins(plant, TrackerGains(0.01))),
        ("designed", designed.integral, designed.proportional, margins(plant, designed)),
        ("observer", None, None, margins_of(seen, f, stable=True)),
    ]
    return [
        {
            "controller": name,
            "integral_per_cycle": integral,
            "proportional": proportional,
            "crossover_hz": round(found.crossover_hz, 3),
            "phase_margin_deg": round(float(found.phase_deg), 1),
            "gain_margin_db": round(float(found.gain_db), 1),
            "sensitivity": round(found.sensitivity, 2),
            "lag_ms": round(plant.slow_s / MS, 1),
            "delay_ms": round(plant.delay_s / MS, 1),
            "mode_hz": mode[0],
        }
        for name, integral, proportional, found in rows
    ]


def margin_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Margins as printed."""
    return [
        [
            row["controller"],
            "" if row["integral_per_cycle"] is None else f"{row['integral_per_cycle']:.4f}",
            "" if row["proportional"] is None else f"{row['proportional']:.3f}",
            f"{row['crossover_hz']:.2f}",
            f"{row['phase_margin_deg']:.0f}",
            f"{row['gain_margin_db']:.1f}",
            f"{row['sensitivity']:.2f}",
        ]
        for row in summary["margins"]
    ]


def figure_rows(summary: Mapping[str, Any]) -> list[list[str]]:
    """Figures of all runs as printed."""
    rows = []
    for row in summary["seeds"]:
        for name, shapes in row["variants"].items():
            for shape, zone, title in STRETCHES:
                if zone not in shapes[shape]:
                    continue
                f = shapes[shape][zone]
                values = [f[what][k] for what in ("contour", "total") for k in ("rms_um", "max_um")]
                values.append(f["orientation"]["max_mdeg"])
                rows.append([str(row["seed"]), name, title, *(f"{v:.1f}" for v in values)])
    return rows


def verdict(summary: Mapping[str, Any]) -> str:
    """The result in one sentence: worst over the truths."""
    contour, straights, corner = (
        summary["goals"][key] for key in ("circle_contour_reduction", "straights_total_rms_um", "corner_peak_ratio")
    )
    return (
        f"Over {len(summary['seeds'])} simulated cells the designed controller takes at least "
        f"{100.0 * contour['worst']:.0f} % of the circle's contour error away "
        f"(published gain {100.0 * contour['published_worst']:.0f} %, Mandiola2023 66 %), leaves at most "
        f"{straights['worst']:.0f} um rms on the straights (tracker about 25 um), and its peak at corners is at most "
        f"{corner['worst']:.2f} of the published gain's."
    )


def paper_lines(paper: Mapping[str, Any]) -> list[str]:
    """What Mandiola2023 reports."""
    return [
        f"Circle of 150 mm radius at 700 mm/min: path errors reduced by {100.0 * paper['circle_reduction']:.0f} %.",
        f"Static errors {paper['static_um'][0]:g} to {paper['static_um'][1]:g} um, above {paper['moving_um']:g} um in "
        f"motion; after compensation close to the tracker's {paper['tracker_um']:g} um, with peaks at corners and "
        "reversals.",
        "Stäubli RX160 in a laboratory; here a simulated KR 300 with drives that trail in the same way.",
    ]


def page(summary: Mapping[str, Any], case: Case, read: Any) -> str:
    """The page of a reproduction.

    Args:
        summary: Of the job.
        case: The truth whose runs are drawn.
        read: Gives a run of that truth by shape and variant.
    """
    square, circle = [], []
    for name in VARIANTS:
        run = read("square", name)
        straight, corner = tracking.corner_zones(run, case.corners, 0.0)
        square.append(TrackedRun(name, run.time_s, run.p_command, run.p_actual, straight | corner))
        run = read("circle", name)
        turn = tracking.turn_zone(run, RUN_IN_DEG * DEG)
        circle.append(TrackedRun(name, run.time_s, run.p_command, run.p_actual, np.asarray(turn, dtype=bool)))
    data = TrackingData(
        title="Tracker in the loop, after Mandiola 2023",
        subtitle=f"400 mm square and 150 mm circle at 700 mm/min, size {summary['scale']:g}; drawn: seed {case.seed}",
        created="",
        verdict=verdict(summary),
        columns=COLUMNS,
        rows=figure_rows(summary),
        margin_columns=MARGIN_COLUMNS,
        margin_rows=margin_rows(summary),
        paper=paper_lines(summary["paper"]),
        square=square,
        circle=circle,
        versions={"counterflex": __version__},
    )
    return tracking_page(data)
