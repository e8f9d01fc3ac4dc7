"""Command plan entry: soft entries and exits of cuts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import MODEL_NOTE, MODEL_UM, keep_inputs, line_of, print_result, print_table, progress_bar
from counterflex.core.units import DEG, MM

if TYPE_CHECKING:
    from counterflex.app.strategy.entry_text import Moves


@dataclass(frozen=True)
class EntryOptions:
    """Options that shape entries and exits."""

    radius_mm: Annotated[
        float | None, option("--radius-mm", "Radius of the arcs; the cutter's otherwise.", min=0.1, max=500.0)
    ] = None
    angle_deg: Annotated[float, option("--angle-deg", "Angle that the arcs turn.", min=5.0, max=180.0)] = 90.0
    ramp_deg: Annotated[float, option("--ramp-deg", "Slope of a ramp into a slot.", min=0.2, max=45.0)] = 10.0
    edges: Annotated[bool, option("--edges", "Slots that begin over an edge of the blank get a ramp, too.")] = False

    def moves(self) -> Moves:
        """Moves that are asked for, in SI."""
        from counterflex.app.strategy.entry_text import Moves

        radius_m = None if self.radius_mm is None else self.radius_mm * MM
        return Moves(radius_m, self.angle_deg * DEG, self.ramp_deg * DEG, self.edges)


@with_records
def entry(
    program: Program,
    cell: CellFile,
    out: Out,
    shape: EntryOptions,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Rewrite plunges and retracts at the beginning and end of cuts as arcs beside a wall and ramps into a slot.

    A cut over an edge of the blank begins with a run-up of 10 mm through the air in its own direction: the axes then
    move as they will in the cut, and what they lose where they turn round is lost before the first contact.

    Entries and exits are found in the stock simulation. Where a move would cut what the program leaves, or leave what
    it cuts, the program is kept as it is there. Force and error of both are printed. Writes into DIR the program under
    its own name, and summary.json.

    Example: `counterflex plan entry part.ngc --cell cell.toml --edges --out soft`
    """
    keep_inputs(out, program, source.parameters)
    from counterflex.app.strategy import entry as job

    with progress_bar(f"entries of {program.name}") as progress:
        summary = job.run(program, cell, out, shape.moves(), reading=source.reading(), progress=progress)
    print_result(summary, as_json, _show, out)


def _show(summary: dict[str, Any], out: Path) -> None:
    rows = [
        [
            line_of(row, bare=True),
            row["kind"],
            row["move"] or f"kept: {row['kept']}",
            _pair(row["peak_force_n"], ".0f"),
            _pair(row["force_step_n_per_ms"], ".2f"),
            _pair(row["error_um"], ".0f"),
        ]
        for row in summary["entries"]
    ]
    head = ["line", "entry", "move", "peak force N", "force step N/ms", f"error, {MODEL_UM}"]
    before, after = summary["time_s"]
    print_table(f"{summary['program']}: entries and exits, {before:g} -> {after:g} s", head, rows, note=MODEL_NOTE)
    typer.echo(f"wrote {out}: {summary['program']}, summary.json")


def _pair(values: list[float | None], form: str) -> str:
    return " -> ".join(format(value, form) for value in values if value is not None)
