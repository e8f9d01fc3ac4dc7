"""Tables and page of the reproduction of Mandiola2023."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.lowest_mode import lowest_mode
from counterflex.core.units import DEG, MM, MS
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.online import OnlineTable, tracker_plant
from counterflex.runtime.design.tracker import Margins, TrackerGains, grid, margins, margins_of, observer_response
from counterflex.runtime.design.tracker_plant import TrackerPlant
from counterflex.runtime.settings import OnlineSettings
from counterflex_lab.reproduce import tracking
from counterflex_lab.reproduce.mandiola_case import RUN_IN_DEG, VARIANTS, Case
from counterflex_lab.reproduce.tracking_figures import OpenLoop, TrackedRun
from counterflex_lab.reproduce.tracking_page import TrackingData, tracking_page

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
MARGIN_COLUMNS: Final = ("controller", "Ki per cycle", "Kp", "crossover Hz", "phase margin deg", "gain margin dB", "Ms")
STRETCHES: Final = (
    ("circle", "turn", "circle"),
    ("circle", "reversals", "after reversals"),
    ("square", "straights", "straights"),
    ("square", "corners", "corners"),
)
PUBLISHED_GAIN: Final = 0.01
CORNER_SHOWN_M: Final = 1.5 * MM
"""Half of what is shown of a corner: the published gain rounds it by a millimetre."""
_OBSERVER: Final = OnlineTable(force="none", tracker="observer")


@dataclass(frozen=True)
class Controller:
    """One controller of the tracker loop on the robot of a cell file."""

    loop: OpenLoop  # its open loop
    integral: float | None  # Ki per cycle, or None where it has none
    proportional: float | None  # Kp, likewise
    margins: Margins  # of the loop
    plant: TrackerPlant  # the robot that it was computed on


def open_loops(cell_file: Path) -> list[Controller]:
    """The published gain, the designed controller and the observer, on the robot of a cell file."""
    cell = read_cell(cell_file)
    table = cell.tables.online or _OBSERVER
    lowest = lowest_mode(cell)
    mode = (lowest.hz, lowest.damping_ratio)
    chosen: OnlineSettings = table.settings(cell.tables.timing, compensated=False, mode=mode)
    period = chosen.period_s
    plant = tracker_plant(chosen.delays, period, mode)
    newest = tracker_plant(replace(chosen.delays, tracker_s=0.0), period, mode)  # the published one takes no mean
    tuning = chosen.tuning
    designed = TrackerGains(tuning.gain, tuning.proportional, tuning.notch)
    usual = _OBSERVER.settings(None, compensated=False).tuning
    f = grid(period)
    out = []
    for name, robot, gains in (("published", newest, TrackerGains(PUBLISHED_GAIN)), ("designed", plant, designed)):
        response = robot.response(f) * gains.response(f, period)
        loop = OpenLoop(name, f, response)
        out.append(Controller(loop, gains.integral, gains.proportional, margins(robot, gains), robot))
    seen = observer_response(newest, usual.drift_m**2 * period, usual.noise_m**2, f) * newest.response(f)
    out.append(Controller(OpenLoop("observer", f, seen), None, None, margins_of(seen, f, stable=True), newest))
    return out


def margin_table(controllers: Sequence[Controller]) -> list[dict[str, Any]]:
    """Margins of controllers, as plain values for the summary."""
    return [
        {
            "controller": item.loop.name,
            "integral_per_cycle": item.integral,
            "proportional": item.proportional,
            "crossover_hz": round(item.margins.crossover_hz, 3),
            "phase_margin_deg": round(float(item.margins.phase_deg), 1),
            "gain_margin_db": round(float(item.margins.gain_db), 1),
            "sensitivity": round(item.margins.sensitivity, 2),
            "lag_ms": round(item.plant.slow_s / MS, 1),
            "delay_ms": round(item.plant.delay_s / MS, 1),
            "mode_hz": round(item.plant.mode_per_s / (2.0 * math.pi), 3),
        }
        for item in controllers
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
    count = len(summary["seeds"])
    cells = "one simulated cell" if count == 1 else f"{count} simulated cells"
    return (
        f"Over {cells} the designed controller takes at least "
        f"{100.0 * contour['worst']:.0f} % of the circle's contour error away "
        f"(published gain {100.0 * contour['published_worst']:.0f} %, Mandiola2023 66 %), leaves at most "
        f"{straights['worst']:.0f} um rms on the straights (tracker about 25 um), and its peak at corners is at most "
        f"{corner['worst']:.2f} of the published gain's."
    )


def _worst(summary: Mapping[str, Any], variant: str, *keys: str) -> str:
    """Largest figure over the truths, a dash where no run has it."""
    values = []
    for row in summary["seeds"]:
        value: Any = row["variants"][variant]
        for key in keys:
            value = value.get(key, {}) if isinstance(value, Mapping) else value
        if isinstance(value, int | float):
            values.append(float(value))
    return f"{max(values):.0f}" if values else "-"


def paper_comparison(summary: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table of the paper's figures beside those found here, worst over the truths."""
    paper, (low, high) = summary["paper"], summary["paper"]["overall_reduction"]
    rows = []
    for title, reported, key in (
        ("contour", f"{100.0 * paper['circle_reduction']:.0f}", "circle_contour_rms"),
        ("total", f"{100.0 * low:.0f} to {100.0 * high:.0f}", "circle_total_rms"),
    ):
        least = [100.0 * min(item[name][key] for item in summary["reductions"]) for name in ("published", "designed")]
        rows.append([f"circle: {title} error taken away, %", reported, "", *(f"{value:.1f}" for value in least)])
    for title, reported, keys in (
        ("circle: contour error rms, um", "", ("circle", "turn", "contour", "rms_um")),
        ("circle: contour error max, um", "above 200", ("circle", "turn", "contour", "max_um")),
        ("in motion: total error max, um", f"above {paper['moving_um']:g}", ("circle", "turn", "total", "max_um")),
        ("straights: total error rms, um", f"{paper['tracker_um']:g}", ("square", "straights", "total", "rms_um")),
        ("corners: total error max, um", "peaks", ("square", "corners", "total", "max_um")),
        ("orientation max on the circle, mdeg", "50 to 150", ("circle", "turn", "orientation", "max_mdeg")),
    ):
        rows.append([title, reported, *(_worst(summary, name, *keys) for name in VARIANTS)])
    return ["worst truth", "Mandiola2023", *VARIANTS], rows


def paper_lines(paper: Mapping[str, Any]) -> list[str]:
    """Figures that Mandiola2023 reports."""
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
        read: Gives a run of that truth by shape and variant, and the points of the path nearest to it.
    """
    square, circle = [], []
    for name in VARIANTS:
        run, path = read("square", name)
        straight, corner = tracking.corner_zones(run, case.corners, 0.0)
        square.append(TrackedRun(name, run.time_s, run.p_command, run.p_actual, path, straight | corner))
        run, path = read("circle", name)
        turn = np.asarray(tracking.turn_zone(run, RUN_IN_DEG * DEG), dtype=bool)
        turned = [(row, axis + 1) for row, axis in sorted(tracking.reversals(run.q))]
        circle.append(TrackedRun(name, run.time_s, run.p_command, run.p_actual, path, turn, turned))
    data = TrackingData(
        title="Tracker in the loop, after Mandiola 2023",
        subtitle=f"400 mm square and 150 mm circle at 700 mm/min, size {summary['scale']:g}; drawn: seed {case.seed}",
        created="",
        verdict=verdict(summary),
        comparison=paper_comparison(summary),
        columns=COLUMNS,
        rows=figure_rows(summary),
        margin_columns=MARGIN_COLUMNS,
        margin_rows=margin_rows(summary),
        paper=paper_lines(summary["paper"]),
        square=square,
        circle=circle,
        loops=[item.loop for item in open_loops(case.cell("designed"))],
        p_part=case.corners[1],
        reach_m=CORNER_SHOWN_M,
        versions={"counterflex": __version__},
    )
    return tracking_page(data)
