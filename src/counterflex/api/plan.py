"""Plans: check a program, choose its posture, compensate it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from counterflex.api.cell import Cell, model_of
from counterflex.api.program import Program, program_file, reading_of
from counterflex.app.compensation import compensate as job
from counterflex.app.compensation.headline import error_rows
from counterflex.app.compensation.prediction import prediction
from counterflex.core import atomic
from counterflex.core.progress import Progress, silent
from counterflex.core.result import Figure, Result
from counterflex.core.units import UM
from counterflex.files.plan_file import plan_table
from counterflex.robot.model.opw import BRANCHES

if TYPE_CHECKING:
    import polars as pl

    from counterflex.app.inputs import Reading
    from counterflex.app.posture import PostureOf
    from counterflex.plan.posture.cut_path import Surface


class Plan(Result):
    """A compensated program with its plan.

    Attributes:
        cell: What it was planned with.
        reading: How the program was read.
        result: Plan (``result.plan``, SI), program files and figures.
    """

    def __init__(self, program: Path, cell: Cell, reading: Reading, result: job.Compensated) -> None:
        self.program, self.cell, self.reading, self.result = program, cell, reading, result

    @property
    def table(self) -> pl.DataFrame:
        """One row per path point, as in ``plan.parquet`` (docs/plan-file.md): mm, um, deg, N."""
        return plan_table(self.result.plan, self.cell.model.chain.axes)

    @property
    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json``."""
        return self.result.summary

    @property
    def files(self) -> dict[str, str]:
        """Text of the program files by name."""
        return self.result.files

    def save(self, folder: str | Path) -> Path:
        """Write program files, ``plan.parquet``, ``summary.json`` and ``report.html`` as the command does.

        Args:
            folder: Made when missing; written whole or not at all.

        Returns:
            The folder.
        """
        with atomic.atomic_folder(folder) as staging:
            job.write_folder(self.result, self.cell.model, self.program, staging)
        return Path(folder)

    def save_program(self, folder: str | Path) -> list[Path]:
        """Write the program files alone; returns their paths."""
        with atomic.atomic_folder(folder) as staging:
            job.write_programs(self.result, staging)
        return [Path(folder) / name for name in self.files]

    def _lines(self) -> list[str]:
        rows = error_rows(self.summary["prediction"])
        head = f"{self.summary['program']} on {self.summary['cell']}, compensated"
        return [head, *(f"{name}: {value}" for name, value, _ in rows)]

    def _pictures(self) -> dict[str, Figure]:
        """Pictures of ``plot``.

        ``along`` (deflection, correction and force over the length of the program), ``map`` (the path from above in the
        colours of the deflection), ``remaining`` (error before and after by the model), ``cell`` (robot, part, reach).
        """
        from counterflex.report.cell_figure import cell_figure
        from counterflex.report.remaining_figure import remaining_figure
        from counterflex.report.series_figure import prediction_figure, prediction_map

        result = self.result
        data = prediction(result.plan, self.cell.model, self.summary, result.limited, places=result.places)
        pictures: dict[str, Figure] = {"along": lambda: prediction_figure(data), "map": lambda: prediction_map(data)}
        if data.error_before_m is not None:
            pictures["remaining"] = lambda: remaining_figure(data)
        drawing = data.drawing
        if drawing is not None:
            pictures["cell"] = lambda: cell_figure(drawing)
        return pictures


def compensate(
    program: Program | str | Path,
    cell: Cell | str | Path,
    *,
    language: str | None = None,
    dialect: str | None = None,
    tolerance_um: float = 5.0,
    normal_only: bool = False,
    predict: bool = True,
    progress: Progress = silent,
) -> Plan:
    """Predict force and deflection along a program and write it compensated.

    Args:
        program: Program, or program file.
        cell: Cell, or cell file.
        language: Of the output: ``gcode``, ``krl``, ``rapid``, ``fanuc``, ``val3``, or one of another package; None is
            that of the program.
        dialect: Of the program; None is by its name and content (``counterflex path --help``).
        tolerance_um: Largest distance between the written path and the planned one.
        normal_only: Correct square to the feed only.
        predict: Predict the error before and after; takes half of the time.
        progress: Called with the share done, 0 to 1, and what is being done; may raise to interrupt.

    Raises:
        CounterflexError: Program, cell or reach do not allow it.
    """
    model = model_of(cell)
    reading = reading_of(program, dialect)
    result = job.compensate(
        program_file(program),
        model,
        language=language,
        reading=reading,
        tolerance_m=tolerance_um * UM,
        normal_only=normal_only,
        predict=predict,
        progress=progress,
    )
    return Plan(program_file(program), cell if isinstance(cell, Cell) else Cell(model), reading, result)


class Posture(Result):
    """The posture of least deflection for a program, beside the present one.

    Attributes:
        result: Angles along the path and figures.
    """

    def __init__(self, result: PostureOf) -> None:
        self.result = result

    @property
    def table(self) -> pl.DataFrame:
        """Deflection of every posture that can run the program.

        Columns ``branch``, ``rotation_about_tool_deg``, ``deflection_um`` (99.7 % of the cut, square to the surfaces).
        """
        import polars as pl

        costs = self.result.chosen.costs_m / UM
        step = 360.0 / len(costs)
        rows = [
            {"branch": branch, "rotation_about_tool_deg": k * step, "deflection_um": float(costs[k, i])}
            for i, branch in enumerate(BRANCHES)
            for k in range(len(costs))
            if np.isfinite(costs[k, i])
        ]
        return pl.DataFrame(rows)

    @property
    def summary(self) -> dict[str, Any]:
        """Both postures, as ``counterflex plan posture --json`` prints them."""
        return self.result.summary

    def _lines(self) -> list[str]:
        keys = (("present", self.summary["present"]), ("chosen", self.summary["chosen"]))
        return [
            f"{name}: {figures['branch']}, {figures['rotation_about_tool_deg']:g} deg about the tool, "
            f"{figures['deflection_um']:g} um"
            for name, figures in keys
            if figures is not None
        ]

    def _pictures(self) -> dict[str, Figure]:
        return {"rotations": self._rotations}

    def _rotations(self) -> dict[str, Any]:
        """Deflection over the rotation about the tool axis, a curve for each arm configuration."""
        table = self.table
        traces = []
        for (branch,), rows in table.group_by("branch", maintain_order=True):
            flipped = "noflip" not in str(branch)
            line = {
                "color": "#0369a1" if "front" in str(branch) else "#c2410c",
                "width": 2 if flipped else 5,
                "dash": "dot" if flipped else "solid",
            }
            x, y = (rows[name].to_list() for name in ("rotation_about_tool_deg", "deflection_um"))
            traces.append({"type": "scatter", "x": x, "y": y, "name": branch, "mode": "lines", "line": line})
        layout = {
            "xaxis": {"title": {"text": "rotation about the tool axis, deg"}, "dtick": 45},
            "yaxis": {"title": {"text": "deflection across the path, um"}, "rangemode": "tozero"},
        }
        return {"data": traces, "layout": layout}


def choose_posture(
    program: Program | str | Path,
    cell: Cell | str | Path,
    *,
    surface: Surface = "both",
    rotations: int = 72,
    progress: Progress = silent,
) -> Posture:
    """Choose arm configuration and rotation about the tool axis; see ``counterflex plan posture --help``.

    Args:
        program: Program, or program file.
        cell: Cell, or cell file.
        surface: Surface that must be true: ``wall``, ``floor``, ``both``.
        rotations: Number of rotations about the tool axis that are tried.
        progress: Called with the share done, 0 to 1.

    Raises:
        CounterflexError: No posture is possible; says where and why.
    """
    from counterflex.app.posture import PostureOf
    from counterflex.plan.posture.choose import Freedom

    freedom = Freedom(rotations)
    return Posture(
        PostureOf.of(program_file(program), model_of(cell), surface=surface, freedom=freedom, progress=progress)
    )


def preflight(program: Program | str | Path, cell: Cell | str | Path, *, progress: Progress = silent) -> pl.DataFrame:
    """Check a program on a cell before it runs: limits, speeds, singularities, reversals, collisions.

    Args:
        program: Program, or program file.
        cell: Cell, or cell file.
        progress: Called with the share done, 0 to 1.

    Returns:
        One row per check, as ``counterflex preflight`` prints it.

    Raises:
        CounterflexError: The program cannot be read, or the cell describes no milling.
    """
    import polars as pl

    from counterflex.app import preflight as checks

    reading = reading_of(program)
    checked = checks.check(program_file(program), model_of(cell), reading=reading, progress=progress)
    return pl.DataFrame(checked.summary["checks"], infer_schema_length=None, strict=False)
