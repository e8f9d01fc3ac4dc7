"""Logs of runs with the robot: what the loop saw, computed and sent in every cycle."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from counterflex.app.run_history import pages
from counterflex.app.run_history.logged_run import RunOfHistory
from counterflex.core.result import Figure, Result
from counterflex.core.units import MM, NS, UM

if TYPE_CHECKING:
    from counterflex.app.run_history.logged_run import RunOfHistory


class RunLog(Result):
    """A run, read from its log.

    Attributes:
        run: Curves and incidents, SI.
    """

    def __init__(self, folder: Path, run: RunOfHistory) -> None:
        self.folder, self.run = folder, run

    @property
    def table(self) -> pl.DataFrame:
        """One row per cycle: ``time_s`` since the first, ``length_mm`` along the program, ``cuts``, ``corrects``.

        Across the feed and along the tool: ``deflection_*_um`` by the model, ``correction_*_um`` sent,
        ``measured_*_um`` (by a tracker; null between its samples); ``force_n`` and ``planned_force_n``.
        """
        curves = self.run.curves
        columns: dict[str, Any] = {
            "time_s": (curves.time_ns - curves.time_ns[0]) * NS,
            "length_mm": curves.length_m / MM,
            "cuts": curves.cut,
            "corrects": curves.active,
        }
        pairs = (("deflection", curves.deflection_m), ("correction", curves.sent_m), ("measured", curves.measured_m))
        for name, values in pairs:
            columns |= {f"{name}_{side}_um": values[:, k] / UM for k, side in enumerate(("across", "along"))}
        columns |= {"force_n": curves.force_n, "planned_force_n": curves.planned_n}
        return pl.DataFrame(columns).fill_nan(None)

    @property
    def summary(self) -> dict[str, Any]:
        """Figures of the run, as ``counterflex log page`` writes them, with its incidents."""
        return {**self.run.row, "incidents_by_number": [one.shown() for one in self.run.incidents]}

    def save(self, folder: str | Path) -> Path:
        """Write ``report.html`` and ``summary.json`` as ``counterflex log page`` does."""
        pages.page(self.folder, Path(folder), self.run.row["run"])
        return Path(folder)

    def _lines(self) -> list[str]:
        row = self.run.row
        return [
            f"run {row['run']} of {row['folder']}: {row['program'] or 'program not known'}",
            pages.verdict(self.run),
        ]

    def _pictures(self) -> dict[str, Figure]:
        """``curves``: deviation, correction and force along the path, or over time where the run followed no plan."""
        return {"curves": self._curves}

    def _curves(self) -> dict[str, Any]:
        from counterflex.report.run_history.page import curves_figure

        by_length = float(self.run.curves.length_m.max()) > 0.0
        name = f"run {self.run.row['run']}"
        return curves_figure([(name, self.run.curves, self.run.contained_m)], by_length=by_length)


def read_run(folder: str | Path, number: int | None = None) -> RunLog:
    """Read a run from its log.

    Args:
        number: Of the run, as ``counterflex log show`` prints it; None is the last.

    Raises:
        CounterflexError: There is no such run, or its log cannot be read.
    """
    return RunLog(Path(folder), RunOfHistory.of(Path(folder), number, "number"))
