"""Command plan trochoid: straight slots rewritten as loops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.core.units import DEG, MM

if TYPE_CHECKING:
    from counterflex.app.strategy.trochoid import Trochoid

_SIDES = ("up", "down")


@dataclass(frozen=True)
class LoopOptions:
    """Options of the loops."""

    tool: Annotated[
        int | None,
        option("--tool", "Number of a smaller tool; the slot stays as wide as the program's.", min=0, max=99999),
    ] = None
    width_mm: Annotated[
        float | None, option("--width-mm", "Width of the slot: keeps the program's tool.", min=0.01, max=1000.0)
    ] = None
    engagement_deg: Annotated[
        float | None,
        option(
            "--engagement-deg",
            "Largest angle of engagement; that without mean force normal to the loop otherwise.",
            min=1.0,
            max=119.0,
        ),
    ] = None
    fz_mm: Annotated[
        float | None, option("--fz-mm", "Feed per tooth; the program's otherwise.", min=1e-4, max=10.0)
    ] = None
    milling: Annotated[str, option("--milling", "up or down.", arguments.one_of(_SIDES, "side"))] = "up"

    def requested(self) -> Trochoid:
        """Trochoid that is asked for, in SI."""
        from counterflex.app.strategy.trochoid import Trochoid

        return Trochoid(
            tool=self.tool,
            width_m=None if self.width_mm is None else self.width_mm * MM,
            engagement_rad=None if self.engagement_deg is None else self.engagement_deg * DEG,
            fz_m=None if self.fz_mm is None else self.fz_mm * MM,
            up=self.milling == "up",
        )


@with_records
def trochoid(
    program: Program,
    cell: CellFile,
    out: Out,
    loops: LoopOptions,
    source: ReadingOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Rewrite the straight slots of a program as loops of a smaller tool whose engagement stays below an angle.

    Radius and step of the loops follow from width, tool and angle; the feed from the feed per tooth, or from the
    controller's acceleration where that binds. The result is cut in the stock model: its engagement and volume are
    printed beside what was asked for. Writes into DIR the program under its own name, and summary.json.

    Example: `counterflex plan trochoid part.ngc --cell cell.toml --width-mm 20 --engagement-deg 40 --out loops`
    """
    keep_inputs(out, program, source.parameters)
    from counterflex.app.strategy import trochoid as job

    with progress_bar(f"loops for {program.name}") as progress:
        summary = job.run(program, cell, out, loops.requested(), reading=source.reading(), progress=progress)
    print_summary(summary, as_json, out, ": {program}, summary.json")
