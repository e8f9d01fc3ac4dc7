"""``compensate``: a program in, the same program compensated out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from counterflex.app.compensation import compensate as job
from counterflex.app.compensation.headline import error_rows
from counterflex.app.compensation.prediction import prediction
from counterflex.app.inputs import Reading
from counterflex.core import atomic
from counterflex.core.progress import Progress, silent
from counterflex.core.units import UM
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.plan_file import plan_table
from counterflex.plan.plan import Plan

if TYPE_CHECKING:
    import plotly.graph_objects as go
    import polars as pl


@dataclass(frozen=True, eq=False)
class Compensation:
    """A compensated program with its plan.

    Attributes:
        program: The original program.
        cell: What it was planned with.
        result: All that was found.
        reading: How the program was read.
    """

    program: Path
    cell: Cell
    result: job.Compensated
    reading: Reading

    @property
    def plan(self) -> Plan:
        """Prediction and correction of every path point, SI."""
        return self.result.plan

    @property
    def summary(self) -> dict[str, Any]:
        """What ``summary.json`` of the command holds."""
        return self.result.summary

    @property
    def files(self) -> dict[str, str]:
        """Text of the program files by name."""
        return self.result.files

    @property
    def table(self) -> pl.DataFrame:
        """One row per path point, as in ``plan.parquet`` (docs/plan-file.md): mm, um, deg, N."""
        return plan_table(self.plan, self.cell.chain.axes)

    def __repr__(self) -> str:
        """Say what the plan expects, the figures to plan with first; what a notebook shows of it."""
        rows = error_rows(self.summary["prediction"])
        head = f"{self.summary['program']} on {self.summary['cell']}, compensated"
        return "\n".join([head, *(f"{name}: {value}" for name, value, _ in rows)])

    def plot(self, kind: str = "along") -> go.Figure:
        """A picture of the plan.

        Args:
            kind: ``along`` (deflection, correction and force over the length of the program), ``map`` (the path from
                above in the colours of the deflection), ``remaining`` (error before and after by the model), ``cell``
                (robot, part and reach).

        Raises:
            InputError: There is no such picture.
        """
        from counterflex.api.figures import figure
        from counterflex.report.cell_figure import cell_figure
        from counterflex.report.remaining_figure import remaining_figure
        from counterflex.report.series_figure import prediction_figure, prediction_map

        data = prediction(self.plan, self.cell, self.summary, self.result.limited, places=self.result.places)
        pictures: dict[str, Any] = {
            "along": lambda: prediction_figure(data),
            "map": lambda: prediction_map(data),
        }
        if data.error_before_m is not None:
            pictures["remaining"] = lambda: remaining_figure(data)
        drawing = data.drawing
        if drawing is not None:
            pictures["cell"] = lambda: cell_figure(drawing)
        return figure(pictures, kind)

    def save_program(self, folder: str | Path) -> list[Path]:
        """Write the program files into a folder, made when missing.

        Returns:
            Their paths.
        """
        with atomic.atomic_folder(folder) as staging:
            for name, text in self.files.items():
                atomic.write_bytes(staging / name, text.encode(self.result.encoding, errors="replace"))
        return [Path(folder) / name for name in self.files]


def compensate(
    program: str | Path,
    cell: Cell | str | Path,
    *,
    language: str | None = None,
    dialect: str | None = None,
    tolerance_um: float = 5.0,
    normal_only: bool = False,
    predict: bool = True,
    progress: Progress = silent,
) -> Compensation:
    """Predict force and deflection along a program and write it compensated.

    Args:
        program: Program file.
        cell: Cell, or cell file.
        language: Of the output: ``gcode``, ``krl``, ``rapid``, ``fanuc``, ``val3``, or one of another package; None is
            that of the program.
        dialect: Of the program; None is the first that ``counterflex path --help`` names.
        tolerance_um: Largest distance between the written path and the planned one.
        normal_only: Correct square to the feed only.
        predict: Predict the error before and after; costs half of the time.
        progress: Called with the share done, 0 to 1, and what is being done; may raise to interrupt.

    Raises:
        CounterflexError: Program, cell or reach do not allow it.
    """
    known = cell if isinstance(cell, Cell) else read_cell(cell)
    reading = Reading() if dialect is None else Reading(dialect)
    result = job.compensate(
        program,
        known,
        language=language,
        reading=reading,
        tolerance_m=tolerance_um * UM,
        normal_only=normal_only,
        predict=predict,
        progress=progress,
    )
    return Compensation(Path(program), known, result, reading)
