"""Page of the groove: what a recorded run shows along the cut, which runs count, and what the page says of goals."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.inputs import read_job
from counterflex.app.proof import simulate
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.summary_file import write_run
from counterflex.path.toolpath import Run
from counterflex_lab.reproduce import haehn_case, haehn_report
from counterflex_lab.reproduce.haehn import GOALS_MM, PAPER, goal, over_seeds
from counterflex_lab.reproduce.way import REFUSED

OFF_MM = 0.1


def milled(place: Path, edge: str, variant: str) -> None:
    """Record of a tool that runs beside the programmed path, to the left of the feed, wherever it is."""
    cell = read_cell(place / haehn_case.OFFLINE)
    path = read_job(place / haehn_case.PROGRAM, cell).machined
    angle = haehn_case.EDGES[edge] * DEG
    along, left = (np.array([np.cos(angle + turn), np.sin(angle + turn), 0.0]) for turn in (0.0, 0.5 * np.pi))
    time_s = np.arange(0.0, path.time_s[-1], 0.004)
    p = np.stack([np.interp(time_s, path.time_s, path.p_part_tcp[:, k]) for k in range(3)], axis=1)
    after = np.minimum(np.searchsorted(path.time_s, time_s), len(path.time_s) - 1)
    n = len(time_s)
    s = p @ along - haehn_case.MIDDLE_M @ along
    deep = np.isclose(p[:, 2], (40.0 - haehn_case.DEPTH_MM) * MM)
    cuts = deep & (np.abs(s) < 0.5 * haehn_case.cut_length_m(edge))
    run = Run(
        time_s=time_s,
        motion=path.motion[after],
        kind=path.kind[after],
        progress=np.linspace(0.0, 1.0, n),
        p_part_command=p,
        p_part_tcp=p + OFF_MM * MM * left,
        tilt_part=np.zeros((n, 3)),
        force_part=np.where(cuts, 500.0, 0.0)[:, None] * along,
        moment_part=np.zeros((n, 3)),
        force_peak_n=np.zeros(n),
        depth_m=np.where(cuts, haehn_case.DEPTH_MM * MM, 0.0),
        q_motor=np.zeros((n, 6)),
    )
    (place / variant).mkdir()
    write_run(place / variant / simulate.RUN, run, {})


def figures(path_mm: float, *, active: bool = True) -> dict[str, Any]:
    parts = {"path": path_mm, "entry": 0.5 * path_mm, "plateau": 0.4 * path_mm, "exit": 0.8 * path_mm}
    states = {"active": 9} if active else {"idle": 9}
    return {name: {"max_mm": value} for name, value in parts.items()} | {"loop": {"states": states}}


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("haehn")
    rows = []
    for edge in haehn_case.EDGES:
        place = folder / "seed-1" / edge
        haehn_case.write_cells(haehn_case.demonstration_cell(), place, edge)
        found = {
            "uncompensated": figures(1.5, active=False),
            "force": figures(9.0, active=False),
            "hybrid": figures(0.1),
        }
        for name in ("uncompensated", "hybrid"):
            milled(place, edge, name)
        rows.append({"seed": 1, "edge": edge, "truth_level": "catalogue", "variants": found})
    total = over_seeds(rows)
    summary = {
        "truth_level": "catalogue",
        "seeds": rows,
        "variants": total,
        "goals": {name: goal(total.get(name, {}), limit) for name, limit in GOALS_MM.items()},
        "paper": PAPER,
    }
    return folder, summary


def drawn(page: str) -> dict[str, Any]:
    text = re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)
    assert text is not None
    found: dict[str, Any] = json.loads(text.group(1))
    return found


def test_the_curves_are_those_of_the_recorded_tool(job: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = job
    found = drawn(haehn_report.page(summary, folder))
    for edge in haehn_case.EDGES:
        end = haehn_case.cut_length_m(edge) / MM
        traces = {(t["name"], t["yaxis"]): t for t in found[f"along_{edge}"]["data"]}
        assert {name for name, _ in traces} == {"uncompensated", "hybrid"}
        error, force = traces["hybrid", "y"], traces["hybrid", "y3"]
        values = [v for v in error["y"] if v is not None]
        places = [x for x, v in zip(error["x"], error["y"], strict=True) if v is not None]
        assert np.allclose(values, OFF_MM, atol=2e-4)
        assert min(places) == pytest.approx(0.0, abs=0.6)
        assert max(places) == pytest.approx(end, abs=0.6)
        inside = [f for x, f in zip(force["x"], force["y"], strict=True) if 1.0 < x < end - 1.0]
        assert np.allclose(inside, 500.0)
        depth = [v for v in traces["hybrid", "y2"]["y"] if v is not None]
        assert np.allclose(depth, 0.0, atol=1e-6)


def test_what_did_not_act_is_not_drawn_and_not_counted(job: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = job
    page = haehn_report.page(summary, folder)
    assert REFUSED in page
    marks = drawn(page)["dots"]["data"]
    counted = {name for t in marks if t["name"] == "whole cut" for name in t["y"]}
    assert counted == {"uncompensated", "hybrid"}
    rows = {row[0]: row[1:] for row in haehn_report.table_rows(summary)}
    assert rows["force"][-1] == "0 of 2"
    assert rows["force"][0] == "-"
    assert rows["uncompensated"][0] == "1.500"


def test_goals_are_met_only_by_what_ran(job: tuple[Path, dict[str, Any]]) -> None:
    _, summary = job
    assert summary["goals"]["hybrid"] == {"limit_mm": 0.15, "worst_mm": 0.1, "met": True}
    assert summary["goals"]["force_pilot"] == {"limit_mm": 0.3, "worst_mm": None, "met": False}
    assert not goal({"path": {"max_mm": 0.1}, "refused": 1}, 0.15)["met"]
    assert "0.100 mm with the plan, its rest online (goal 0.15 mm, kept)" in haehn_report.verdict(summary)
    assert "pilot" not in haehn_report.verdict(summary)
