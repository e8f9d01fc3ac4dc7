"""The command ``firstcut``: a coupon, milled once and measured, teaches a cell stiffness, force, play and friction."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, numbers, option
from counterflex.cli.commands.program import CellFile, Out
from counterflex.cli.output import keep_inputs, print_summary, progress_bar
from counterflex.core.errors import InputError
from counterflex.core.next_command import next_command
from counterflex.core.units import UM


def firstcut(
    cell: CellFile,
    out: Out,
    program: Annotated[
        Path | None,
        argument("Program that the measured part was made by, uncompensated.", arguments.file, "PROGRAM"),
    ] = None,
    propose: Annotated[
        str | None,
        option(
            "--propose",
            "Write the program of a coupon and the table of what to measure on it, at a feed in mm/min and a spindle "
            "speed in rpm: those of the programs that the cell is to mill.",
            arguments.numbers_of(2),
            "FEED,RPM",
        ),
    ] = None,
    tool: Annotated[int, option("--tool", "Number of the tool.", min=1, max=100_000)] = 1,
    depth_mm: Annotated[
        float | None,
        option("--depth-mm", "Depth of the shallowest slot. [default: a quarter of the diameter]", min=0.1, max=50.0),
    ] = None,
    measured: Annotated[
        Path | None,
        option(
            "--measured",
            "Measured faces. [default: measure.csv beside PROGRAM]",
            arguments.file,
            "FILE",
        ),
    ] = None,
    part: Annotated[
        Path | None,
        option(
            "--part",
            "A scanned or simulated part instead: folder of inspect or simulate. Its faces are those of the table.",
            arguments.file_or_folder,
            "PART",
        ),
    ] = None,
    sigma_um: Annotated[
        float, option("--sigma-um", "Standard deviation of a reading of the table.", min=1.0, max=500.0)
    ] = 15.0,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Teach a cell stiffness, force and play by a coupon, milled once and measured with a probe or a calliper.

    First --propose 1500,13000: coupon.ngc (shoulders, light passes on them, slots with a corner) and measure.csv. Run
    the coupon as it is, without compensation (the command convert writes it for the robot), clamped below the
    shoulders. Probe the faces of measure.csv before the part is taken off, and write each coordinate under measured_mm;
    rows may stay empty. Then, with PROGRAM: a new cell file for every later program, with compliances, force constants,
    play, friction, and how well the faces show them. Faces are left out in turn, to see what the result foretells.

    Other programs than the coupon can be measured as well: each row names an axis and a place on a face.

    Example: `counterflex firstcut coupon/coupon.ngc --measured coupon/measure.csv --cell cell.toml --out identified`
    """
    from counterflex.app.first_cut import first_cut as job

    if (propose is None) == (program is None):
        raise InputError(
            "either a coupon is proposed or a measured part is read", limit="--propose FEED,RPM, or PROGRAM"
        )
    if propose is not None:
        feed_mm_min, rpm = numbers(propose, "--propose", 2) or (0.0, 0.0)
        keep_inputs(out, cell)
        made = job.propose(cell, out, tool=tool, feed_mm_min=feed_mm_min, rpm=rpm, depth_mm=depth_mm)
        print_summary(made, as_json, out)
        if not as_json:
            command = next_command("firstcut", str(out / "coupon.ngc"), cell=cell, out="identified")
            typer.echo(f"when milled and measured: {command}")
        return
    assert program is not None
    keep_inputs(out, program, cell, measured, part)
    with progress_bar(f"identifying from {program.name}") as progress:
        summary = job.run(program, cell, out, measured=measured, part=part, sigma_m=sigma_um * UM, progress=progress)
    print_summary(summary, as_json, out, ": cell.toml, summary.json ({seconds:.1f} s)")
