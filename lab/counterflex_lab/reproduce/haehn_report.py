"""Page of the reproduction of Haehn2020: every figure is of the summary, every curve of a recorded run."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex import __version__
from counterflex.app.inputs import Job, read_job
from counterflex.app.proof import simulate
from counterflex.core.units import DEG
from counterflex.evaluate.path_deviation import path_deviation
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.summary_file import read_run
from counterflex.path.toolpath import FEED
from counterflex_lab.reproduce import haehn_case
from counterflex_lab.reproduce.groove_page import Dot, GrooveData, GrooveRun, groove_page
from counterflex_lab.reproduce.haehn_case import WAYS
from counterflex_lab.reproduce.way import REFUSED

PARTS: Final = ("entry", "plateau", "exit", "path")
EDGE_TITLES: Final = {"straight": "straight edge", "oblique": "edge turned by 40 deg"}
_CARDS: Final = (
    ("uncompensated", "Without correction"),
    ("force", "Measured force"),
    ("force_pilot", "Force and pilot control, shaped plan"),
    ("hybrid", "Plan, and the rest online"),
)


def spread(summary: Mapping[str, Any], name: str, edge: str, part: str) -> str:
    """Median and worst of a figure over the truths, mm; one number of one, a dash where no run counts."""
    values = [
        row["variants"][name][part]["max_mm"]
        for row in summary["seeds"]
        if row["edge"] == edge and WAYS[name].acted(row["variants"][name]) and part in row["variants"][name]
    ]
    if not values:
        return "-"
    return f"{statistics.median(values):.3f} / {max(values):.3f}" if len(values) > 1 else f"{values[0]:.3f}"


def _dots(summary: Mapping[str, Any]) -> list[Dot]:
    return [
        Dot(name, row["edge"], row["seed"], figures["path"]["max_mm"], figures["exit"]["max_mm"])
        for row in summary["seeds"]
        for name, figures in row["variants"].items()
        if WAYS[name].acted(figures)
    ]


def _row(summary: Mapping[str, Any], name: str, edges: Sequence[str]) -> tuple[str, list[str], str, str]:
    total = summary["variants"][name]
    return (
        name,
        [spread(summary, name, edge, part) for edge in edges for part in PARTS],
        f"{summary['paper'][name]:g}" if name in summary["paper"] else "-",
        f"{total['runs']} of {total['runs'] + total['refused']}",
    )


def page(summary: Mapping[str, Any], folder: Path) -> str:
    """The page.

    Args:
        summary: Of the job.
        folder: Of the job: ``seed-N/<edge>/<variant>``.
    """
    run = {row["edge"] for row in summary["seeds"]}
    edges = [edge for edge in haehn_case.EDGES if edge in run]
    names, dots = list(summary["variants"]), _dots(summary)
    best = "hybrid" if "hybrid" in names else names[-1]
    worst = max((d for d in dots if d.variant == best), key=lambda d: d.path_mm, default=dots[0])
    refused = any(total["refused"] for total in summary["variants"].values())
    seeds = sorted({row["seed"] for row in summary["seeds"]})
    data = GrooveData(
        title="A groove corrected online, after Hähn and Weigold 2020",
        subtitle=f"9.5 mm deep, end mill of 16 mm, 25 mm/s; {len(seeds)} simulated cells ({summary['truth_level']}); "
        f"drawn at first: truth {worst.seed}, the worst for {best}",
        created="",
        verdict=verdict(summary),
        cards=_cards(summary),
        parts=PARTS,
        rows=[_row(summary, name, edges) for name in names],
        refused=REFUSED if refused else "",
        edges={edge: haehn_case.cut_length_m(edge) for edge in edges},
        edge_titles=EDGE_TITLES,
        dots=dots,
        runs=_drawn(summary, folder),
        first_seed=worst.seed,
        paper=summary["paper"],
        goals={name: goal["limit_mm"] for name, goal in summary["goals"].items()},
        slender=[name for name in names if name.endswith("_axes")],
        versions={"counterflex": __version__},
    )
    return groove_page(data)


def verdict(summary: Mapping[str, Any]) -> str:
    """The result in one sentence, nothing rounded in favour of a method."""
    total = summary["variants"]
    parts = [f"{total['uncompensated']['path']['max_mm']:.2f} mm without correction"]
    for name, title in (("force_pilot", "with force and pilot control"), ("hybrid", "with the plan, its rest online")):
        goal = summary["goals"].get(name)
        if goal is not None and goal["worst_mm"] is not None:
            outcome = "kept" if goal["met"] else "missed"
            parts.append(f"{goal['worst_mm']:.3f} mm {title} (goal {goal['limit_mm']:g} mm, {outcome})")
    edges = len({row["edge"] for row in summary["seeds"]})
    count = len({row["seed"] for row in summary["seeds"]})
    where = f"{count} simulated cell{'s' if count > 1 else ''} and {edges} edge{'s' if edges > 1 else ''}"
    return f"Over {where} the largest error across the feed is " + ", ".join(parts) + "."


def _cards(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    out = []
    for name, title in _CARDS:
        path = summary["variants"].get(name, {}).get("path")
        if path is None:
            continue
        paper = summary["paper"].get(name if name != "force_pilot" else "force_pilot_40ms")
        subtitle = f"worst; median {path['median_max_mm']:.3f}" + (
            f"; Haehn2020 {paper:g}" if paper is not None else ""
        )
        out.append((title, f"{path['max_mm']:.3f} mm", subtitle))
    return out


def _drawn(summary: Mapping[str, Any], folder: Path) -> list[GrooveRun]:
    out = []
    for row in summary["seeds"]:
        place = folder / f"seed-{row['seed']}" / row["edge"]
        cell = read_cell(place / haehn_case.OFFLINE)
        job = read_job(place / haehn_case.PROGRAM, cell)
        for name, figures in row["variants"].items():
            if WAYS[name].acted(figures):
                out.append(groove_run(place / name, name, row["edge"], row["seed"], job, cell))
    return out


def groove_run(part: Path, name: str, edge: str, seed: int, job: Job, cell: Cell) -> GrooveRun:
    """Errors and force along one groove, from the run file that the simulated cell wrote.

    Args:
        part: Folder of the run.
        name: Of the variant.
        edge: Of :data:`~counterflex_lab.reproduce.haehn_case.EDGES`.
        seed: Of the truth.
        job: The original program.
        cell: Cell file that it was read with.
    """
    run, _ = read_run(part / simulate.RUN)
    deviation = path_deviation(
        job.path,
        run.time_s,
        run.p_part_tcp,
        np.where(run.kind == FEED, run.depth_m, 0.0),
        cell.cutter(simulate.tool_of(job.path)).radius_m,
        command_part_tcp=run.p_part_command,
        progress=run.progress,
    )
    angle = haehn_case.EDGES[edge] * DEG
    along = np.array([math.cos(angle), math.sin(angle), 0.0])
    level = np.abs(deviation.feed_direction @ along) > 1.0 - 1e-6  # without plunging and lifting
    place = deviation.p_part_nominal @ along - (haehn_case.MIDDLE_M @ along - 0.5 * haehn_case.cut_length_m(edge))
    force = np.interp(deviation.time_s, run.time_s, np.linalg.norm(run.force_part, axis=1))
    return GrooveRun(
        variant=name,
        edge=edge,
        seed=seed,
        place_m=place[level],
        left_m=deviation.across_left_m[level],
        axis_m=deviation.across_axis_m[level],
        force_n=force[level],
        cutting=deviation.cutting[level] & ~deviation.broken[level],
        entering=deviation.entry[level],
        leaving=deviation.exit[level],
    )


def table_rows(summary: Mapping[str, Any], figures: Sequence[str] = ("path", "exit")) -> list[list[str]]:
    """Rows of the table that is printed: variant, figures by edge, the paper's, runs counted."""
    edges = list(dict.fromkeys(row["edge"] for row in summary["seeds"]))
    rows = []
    for name, total in summary["variants"].items():
        paper = summary["paper"].get(name)
        cells = [spread(summary, name, edge, figure) for edge in edges for figure in figures]
        runs = f"{total['runs']} of {total['runs'] + total['refused']}"
        rows.append([name, *cells, "-" if paper is None else f"{paper:g}", runs])
    return rows
