"""Reproduce Haehn2020: a groove corrected from force, with pilot control, and with plan and rest, over sockets."""

from __future__ import annotations

import statistics
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from counterflex.app.long_jobs.task import Task
from counterflex.files.schema import write_toml
from counterflex_lab.reproduce import haehn_case, haehn_report
from counterflex_lab.reproduce.experiment import PLAN_FILE, PLANNED, Experiment, Run, mill, plan_task
from counterflex_lab.reproduce.haehn_case import WAYS

PAPER: Final[dict[str, float]] = {"uncompensated": 1.4, "force": 0.7, "force_pilot_40ms": 0.3}
"""Largest deviation of the scanned part, mm (Haehn2020 section 3)."""
GOALS_MM: Final[dict[str, float]] = {"force_pilot": 0.3, "hybrid": 0.15}
"""Largest error that these should leave, at every edge and on every truth."""
_FIGURES: Final = ("path", "entry", "plateau", "exit")


class Groove(Experiment):
    """The groove; quick: straight edge and Cartesian corrections only."""

    name = "groove"
    # The weight on the sensor always is identified: a run is not armed without.
    recipes: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "catalogue": ("payload",),
        "identified": ("tracker-frame", "stiffness", "payload", "play", "servo", "cutting"),
    }

    def catalogue(self) -> Path:
        """Write the demonstration cell with the groove's blank."""
        write_toml(self.folder / "cell.toml", haehn_case.cell_table(haehn_case.demonstration_cell(), 0.0))
        return self.folder / "cell.toml"

    def tasks(self) -> list[Task]:
        """Every edge on every truth, at the feed of the paper, which the original program runs as well."""
        out = []
        for seed, edge in self._places():
            place, planned = self.folder / f"seed-{seed}" / edge, f"{seed}: plan of {edge}"
            haehn_case.write_cells(tomllib.loads(self.cell(seed).read_text(encoding="utf-8")), place, edge)
            program, plan = place / haehn_case.PROGRAM, place / PLANNED
            out.append(plan_task(planned, plan, program, place / haehn_case.OFFLINE, programmed_feed=True))
            for name in self._ways():
                cell, truth = place / haehn_case.cell_name(name), self.truth(seed)
                run = Run(
                    _task(seed, edge, name), place / name, cell, truth, program, plan / PLAN_FILE, WAYS[name], seed
                )
                out.append(run.task(planned, mill))
        return out

    def _places(self) -> list[tuple[int, str]]:
        edges = ("straight",) if self.quick else tuple(haehn_case.EDGES)
        return [(seed, edge) for seed in self.seeds for edge in edges]

    def _ways(self) -> list[str]:
        return [name for name, way in WAYS.items() if not self.quick or way.online["output"] == "cartesian"]

    def summary(self, results: Mapping[str, Any]) -> dict[str, Any]:
        """Rows by truth and edge, figures over them, goals."""
        rows = [
            {
                "seed": seed,
                "edge": edge,
                "truth_level": self.level,
                "variants": {name: results[_task(seed, edge, name)] for name in self._ways()},
            }
            for seed, edge in self._places()
        ]
        total = over_seeds(rows)
        goals = {name: goal(total.get(name, {}), limit) for name, limit in GOALS_MM.items()}
        return {"seeds": rows, "variants": total, "goals": goals, "paper": PAPER}

    def page(self, summary: Mapping[str, Any]) -> str:
        """Figures of the summary, curves of the recorded runs."""
        return haehn_report.page(summary, self.folder)


def _task(seed: int, edge: str, way: str) -> str:
    return f"{seed}: {edge}: {way}"


def goal(figures: Mapping[str, Any], limit_mm: float) -> dict[str, Any]:
    """Worst figure beside its limit; met only where no run was refused."""
    worst = figures["path"]["max_mm"] if "path" in figures else None
    met = worst is not None and worst <= limit_mm and figures["refused"] == 0
    return {"limit_mm": limit_mm, "worst_mm": worst, "met": met}


def over_seeds(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Over truths and edges: ``variants.<name>.path.max_mm`` is the worst, ``.median_max_mm`` the median.

    Runs in which the loop refused to act, though it was to be armed, say nothing of the correction and are left out;
    ``runs`` counts those that are in, ``refused`` the others.

    Args:
        rows: Of the summary.
    """
    out: dict[str, Any] = {}
    for name in dict.fromkeys(name for row in rows for name in row["variants"]):
        counted, out[name] = WAYS[name].counted([row["variants"][name] for row in rows if name in row["variants"]])
        for figure in _FIGURES if counted else ():
            values = [item[figure]["max_mm"] for item in counted]
            out[name][figure] = {"max_mm": max(values), "median_max_mm": round(statistics.median(values), 6)}
    return out
