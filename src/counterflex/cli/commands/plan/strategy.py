"""Command plan strategy: how to finish a wall."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import AssumeClass, CellFile, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.core.units import DEG, MM, PERCENT, RPM

if TYPE_CHECKING:
    from counterflex.app.strategy.advice import WallOperation


def _range(name: str, what: str) -> Any:
    return option(name, f"{what}: a value, or LOW:HIGH.", arguments.positive_range, "RANGE")


@dataclass(frozen=True)
class WallOptions:
    """Options that describe the wall, the cut and the choices that are asked for."""

    tool: Annotated[int | None, option("--tool", "Number of the tool.", min=0, max=99999)] = None
    ae: Annotated[str | None, _range("--ae-mm", "Radial width of cut: the allowance that roughing leaves")] = None
    ap: Annotated[str | None, _range("--ap-mm", "Axial depth")] = None
    fz: Annotated[str | None, _range("--fz-mm", "Feed per tooth")] = None
    rpm: Annotated[str | None, _range("--rpm", "Spindle speed")] = None
    at: Annotated[str | None, option("--at-mm", "Point of the wall, part frame.", arguments.numbers_of(3), "X,Y,Z")] = (
        None
    )
    normal: Annotated[
        float | None,
        option("--normal-deg", "Direction out of the wall, from the part's x towards its y.", metavar="DEG"),
    ] = None
    height_mm: Annotated[
        float | None, option("--height-mm", "Height of the wall, cut in levels.", metavar="MM", min=0.01, max=1000.0)
    ] = None
    material: Annotated[
        str | None,
        option("--material", "Row of the material tables instead of the cell's.", arguments.material, "NAME"),
    ] = None
    kr_over_kc: Annotated[
        float | None, option("--kr-over-kc", "Ratio assumed where that row has no radial constant.")
    ] = None
    ka_over_kc: Annotated[
        float | None, option("--ka-over-kc", "Ratio assumed where that row has no axial constant.")
    ] = None
    time_percent: Annotated[
        float, option("--time-percent", "Longest time, of the program's own.", min=1.0, max=10000.0)
    ] = 100.0
    rows: Annotated[int, option("--rows", "Length of the table.", min=1, max=100)] = 8

    def operation(self) -> WallOperation:
        """Operation that is asked for, in SI."""
        from counterflex.app.strategy.advice import WallOperation

        point = arguments.numbers(self.at, "--at-mm", 3)
        return WallOperation(
            tool=self.tool,
            ae_m=_scaled(self.ae, "--ae-mm", MM),
            ap_m=_scaled(self.ap, "--ap-mm", MM),
            fz_m=_scaled(self.fz, "--fz-mm", MM),
            spindle_rad_s=_scaled(self.rpm, "--rpm", RPM),
            at_m=None if point is None else (point[0] * MM, point[1] * MM, point[2] * MM),
            normal_rad=None if self.normal is None else self.normal * DEG,
            height_m=None if self.height_mm is None else self.height_mm * MM,
            material=self.material,
            kr_over_kc=self.kr_over_kc,
            ka_over_kc=self.ka_over_kc,
            longer_share=self.time_percent * PERCENT,
            rows=self.rows,
        )


@with_records
def strategy(
    cell: CellFile,
    program: Annotated[Path | None, argument("G-code file that finishes a wall.", arguments.file, "PROGRAM")] = None,
    *,
    requested: WallOptions,
    assume_class: AssumeClass = False,
    source: ReadingOptions,
    out: Annotated[
        Path | None,
        option("--out", "Folder for summary.json; made when missing.", arguments.output_folder, "DIR"),
    ] = None,
    as_json: Annotated[bool, option("--json", "Print JSON instead of the table.")] = False,
) -> None:
    """Rank the ways to finish a wall: up- or down-milling, widths, depths, feeds per tooth, spindle speeds.

    The first row is what the program does, the others what leaves less error normal to the wall at its pose, without
    compensation, the smallest first. Each error is given as median and range of nine of ten cells, force and stiffness
    being as uncertain as the cell file leaves them, and as the model computes it. Limits are those of
    [process_limits], of the force constants and of time; those that keep a better choice out are named. Errors are at
    rest in full engagement.

    Without PROGRAM give --ae-mm, --ap-mm, --fz-mm and --rpm.

    Example: `counterflex plan strategy --cell cell.toml --ae-mm 0.5:6 --ap-mm 5 --fz-mm 0.02:0.06 --rpm 13000`
    """
    from counterflex.app.strategy import advice_table

    if out is not None:
        keep_inputs(out, cell, program, source.parameters)
    with progress_bar("strategy" if program is None else f"strategy for {program.name}") as progress:
        answer = advice_table.run(
            cell,
            program,
            requested.operation(),
            out=out,
            assume_class=assume_class,
            reading=source.reading(),
            progress=progress,
        )
    print_summary(answer, as_json)


def _scaled(text: str | None, name: str, unit: float) -> tuple[float, float] | None:
    given = arguments.span(text, name)
    return None if given is None else (given[0] * unit, given[1] * unit)
