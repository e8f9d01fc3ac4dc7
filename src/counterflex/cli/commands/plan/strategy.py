"""Command plan strategy: how to finish a wall."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.program import AssumeClass, CellFile, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import (
    EXPECTED_NOTE,
    EXPECTED_UM,
    MODEL_UM,
    expected_text,
    keep_inputs,
    line_of,
    print_result,
    print_table,
    progress_bar,
)
from counterflex.core.units import DEG, MM, PERCENT, RPM

if TYPE_CHECKING:
    from counterflex.app.strategy.advice import WallOperation


def _range(name: str, what: str) -> Any:
    return option(name, f"{what}: a value, or LOW:HIGH.", arguments.positive_range, "RANGE")


_NOTE: Final = (
    f"Errors square to the wall. {EXPECTED_NOTE} Up to: nine of ten stay below. That of the model has a sign: + leaves "
    "material."
)


FIRST_MODES = 6
"""Printed; ``--json`` has all."""


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
    print_result(answer, as_json, _show)


def _scaled(text: str | None, name: str, unit: float) -> tuple[float, float] | None:
    given = arguments.span(text, name)
    return None if given is None else (given[0] * unit, given[1] * unit)


def _show(answer: dict[str, Any]) -> None:
    listed = [(str(i + 1), row) for i, row in enumerate(answer["choices"])]
    if answer["before"] is not None:
        listed.insert(0, ("before", answer["before"]))
    columns = ["", "milling", "a_e mm", "a_p mm", "f_z mm", "rpm", EXPECTED_UM, "up to um", MODEL_UM, "F normal N"]
    columns += ["s/m", "limit"]
    table = [
        [
            name,
            row["milling"],
            f"{row['ae_mm']:g}",
            f"{row['ap_mm']:g}" + (f" x {row['levels']}" if row["levels"] > 1 else ""),
            f"{row['fz_mm']:g}",
            f"{row['spindle_rpm']:g}",
            expected_text(row),
            f"{row['up_to_um']:.1f}",
            f"{row['error_um']:+.1f}",
            f"{row['normal_n']:+.1f}",
            f"{row['time_s_per_m']:.1f}",
            _limit(row),
        ]
        for name, row in listed
    ]
    print_table(f"{answer['program'] or 'wall'} on {answer['cell']}, {answer['material']}", columns, table, note=_NOTE)
    zero = answer["zero"]
    force, error = (
        "nowhere" if zero[key] is None else f"at a_e = {zero[key]:g} mm"
        for key in ("force_ae_mm", "displacement_ae_mm")
    )
    typer.echo(
        f"up-milling at f_z = {zero['fz_mm']:g} mm: the force normal to the wall is zero {force}, the displacement "
        f"{error} (half the diameter is {zero['half_diameter_mm']:g} mm)"
    )
    typer.echo(_modes(answer["modes"]))
    for name, error_um in answer["binding"].items():
        typer.echo(f"binds: {name}; without it {error_um:g} um instead of {_best(answer)}")
    if not answer["choices"]:
        worst = ", ".join(f"{name} ({count})" for name, count in answer["beyond"].items())
        typer.echo(f"none of {answer['tried']} choices is within the limits: {worst}")
    if answer["not_known"]:
        typer.echo(f"not looked at, because the cell file does not state it: {', '.join(answer['not_known'])}")


def _modes(modes: dict[str, Any]) -> str:
    first = modes["bands_hz"][:FIRST_MODES]
    bands = ", ".join(f"{low:g}" if low == high else f"{low:g} to {high:g}" for low, high in first)
    text = f"first modes along the cut: {bands} Hz"
    nearest = modes["nearest"]
    if nearest is None:
        return text
    where = "" if nearest["line"] is None else f" in {line_of(nearest)}"
    return (
        f"{text}; of tooth passing and runout, {nearest['what']} ({nearest['hz']:g} Hz) swings the tool most{where}: "
        f"{nearest['magnified']:g} of the displacement at rest, the nearest mode is at {nearest['mode_hz']:g} Hz"
    )


def _best(answer: dict[str, Any]) -> str:
    return f"{answer['choices'][0]['up_to_um']:g} um" if answer["choices"] else "none"


def _limit(row: dict[str, Any]) -> str:
    if row["beyond"]:
        return "beyond: " + ", ".join(row["beyond"])
    share = row["nearest_limit_percent"]
    return "" if share is None else f"{share:.0f} % of {row['nearest_limit']}"
