"""Command plan entry: soft entries and exits of cuts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
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
    print_summary(summary, as_json, out, ": {program}, summary.json")
