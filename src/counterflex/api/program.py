"""Programs: read one in any language that counterflex reads, list its motions, write it in another language."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from counterflex.api.cell import Cell, file_of
from counterflex.app.inputs import AS_IT_IS, Reading
from counterflex.app.robot_programs import companions
from counterflex.app.written_out import listed
from counterflex.core import atomic, file_content
from counterflex.core.result import Figure, Result
from counterflex.programs import program as programs
from counterflex.programs.listing import Orientations, listing

if TYPE_CHECKING:
    import polars as pl


class Program(Result):
    """A machining program, as it was read.

    Attributes:
        reading: How it was read.
        model: Motions, blocks and lines, SI.
    """

    def __init__(self, file: Path, reading: Reading, model: programs.Program, held: Orientations) -> None:
        self.file, self.reading, self.model, self._held = file, reading, model, held

    @property
    def table(self) -> pl.DataFrame:
        """One row for each motion, as ``counterflex path`` lists it: ``line``, ``motion``, ``x_mm`` ..."""
        return listing(self.model, self._held)

    @property
    def summary(self) -> dict[str, Any]:
        """Language, number of lines and of motions by kind, tools, and the box around the motions (mm)."""
        table = self.table
        ends = table.select("x_mm", "y_mm", "z_mm").drop_nulls().to_numpy()
        return {
            "program": self.file.name,
            "language": self.model.dialect,
            "lines": len(self.model.lines),
            "motions": dict(Counter(table["motion"].to_list())),
            "tools": sorted({int(tool) for tool in table["tool"].drop_nulls().to_list()}),
            "low_mm": ends.min(axis=0).tolist() if len(ends) else None,
            "high_mm": ends.max(axis=0).tolist() if len(ends) else None,
        }

    def convert(self, language: str, cell: Cell | str | Path, out: str | Path) -> dict[str, Any]:
        """Write the program in another language, without correction; what is written is read back and compared.

        Args:
            language: ``gcode``, ``krl``, ``rapid``, ... as ``counterflex convert --help`` lists them.
            cell: Cell, or cell file.
            out: Folder for the files.

        Returns:
            Files, counts and the largest distance of the points that were read back.

        Raises:
            CounterflexError: The language cannot express a part of the program; names line and word.
        """
        from counterflex.app import conversion

        return conversion.run(self.file, file_of(cell), out, language, reading=self.reading)

    def save(self, folder: str | Path) -> Path:
        """Write the program, with the files that it calls, as it was read into a folder; returns the program's path."""
        with atomic.atomic_folder(folder) as staging:
            for file in (self.file, *companions(self.file)):
                atomic.write_bytes(staging / file.name, file_content.content(file))
        return Path(folder) / self.file.name

    def _lines(self) -> list[str]:
        about = self.summary
        motions = ", ".join(f"{count} {kind}" for kind, count in about["motions"].items())
        return [
            f"{about['program']}: {about['language']}, {about['lines']} lines",
            f"motions: {motions or 'none'}",
            f"tools: {', '.join(f'T{tool}' for tool in about['tools']) or 'none'}",
        ]

    def _pictures(self) -> dict[str, Figure]:
        return {"above": self._above}

    def _above(self) -> dict[str, Any]:
        """Ends of the motions from above; rapids are dashed."""
        table = self.table
        rapid = (table["motion"] == "rapid").to_numpy()
        x, y = (table[name].to_numpy().astype(np.float64) for name in ("x_mm", "y_mm"))
        traces = []
        for name, chosen, line in (
            ("rapid", rapid, {"dash": "dot", "color": "#9aa3ad"}),
            ("feed", ~rapid, {"color": "#0369a1"}),
        ):
            xs, ys = np.full((2, 3 * len(x)), np.nan)
            for values, ends in ((xs, x), (ys, y)):
                values[3::3], values[4::3] = ends[:-1], np.where(chosen[1:], ends[1:], np.nan)
            traces.append({"type": "scatter", "x": xs, "y": ys, "name": name, "mode": "lines", "line": line})
        axes = {"xaxis": {"title": {"text": "x, mm"}}, "yaxis": {"title": {"text": "y, mm"}, "scaleanchor": "x"}}
        return {"data": traces, "layout": axes}


def read_program(file: str | Path, cell: Cell | str | Path | None = None, *, dialect: str | None = None) -> Program:
    """Read a program.

    Args:
        cell: Cell, or cell file, whose frames and tools it is held against; robot languages need one.
        dialect: Language; None is by the file's name and content (``counterflex path --help`` lists them).

    Raises:
        ProgramError: It cannot be read exactly; names line, column and word.
    """
    reading = AS_IT_IS if dialect is None else Reading(dialect)
    model, held = listed(file, reading, None if cell is None else file_of(cell))
    return Program(Path(file), reading, model, held)


def program_file(program: Program | str | Path) -> Path:
    """Return the file of a program."""
    return program.file if isinstance(program, Program) else Path(program)


def reading_of(program: Program | str | Path, dialect: str | None = None) -> Reading:
    """Return how a program is read: as it was read before, or by its dialect."""
    if dialect is not None:
        return Reading(dialect)
    return program.reading if isinstance(program, Program) else AS_IT_IS
