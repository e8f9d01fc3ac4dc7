"""Command modes: natural frequencies and mode shapes of a cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, numbers, option
from counterflex.cli.output import keep_inputs, print_summary, progress_bar


def modes(
    cell: Annotated[Path, argument("Cell file (.toml).", arguments.file, "CELL")],
    joints_deg: Annotated[
        str | None,
        option(
            "--joints --joints-deg",
            "Six joint angles, deg; left out: the posture at the blank.",
            arguments.numbers_of(6),
            "A1,..,A6",
        ),
    ] = None,
    count: Annotated[int, option("--count", "Modes that are listed.", min=1, max=100)] = 6,
    assume_class: Annotated[
        bool, option("--assume-class", "Give axes of unknown stiffness the median of the robot's class.")
    ] = False,
    tap_test: Annotated[
        Path | None,
        option(
            "--tap-test",
            "CSV of a tap test at the tool's tip in this posture: frequency_hz,force,motion,real_um_n,imag_um_n.",
            arguments.file,
            "FILE",
        ),
    ] = None,
    up_to_hz: Annotated[float, option("--up-to-hz", "Rows of the tap test that count.", min=1.0, max=500.0)] = 40.0,
    out: Annotated[
        Path | None,
        option(
            "--out",
            "Folder for summary.json and report.html, in which the modes move; made when missing.",
            arguments.output_folder,
            "DIR",
        ),
    ] = None,
    as_json: Annotated[bool, option("--json", "Print JSON instead of the table.")] = False,
) -> None:
    """Natural frequencies, damping and mode shapes of the elastic cell in a posture.

    From link masses, compliances of joints, bearings and end effector: M x'' + K x = 0, drives rigid unless the cell
    file has their loop gains. Each frequency with the interval that nine of ten such robots lie in, the direction in
    which the tool's tip moves, the mode's share of the compliance at the tip, and the springs that bend most.

    With --tap-test: how well a measured frequency response agrees (FRAC), and masses, one factor on all stiffnesses and
    the damping fitted to it, each held by what the cell file says of it.

    Example: `counterflex modes cell.toml --joints 0,-90,110,0,40,0`
    """
    keep_inputs(out, cell, tap_test)
    from counterflex.app import cell_modes as job

    with progress_bar(f"modes of {cell.name}") as progress:
        summary = job.run(
            cell,
            out,
            joints_deg=numbers(joints_deg, "--joints", 6),
            assume_class=assume_class,
            count=count,
            tap_test=tap_test,
            up_to_hz=up_to_hz,
            progress=progress,
        )
    print_summary(summary, as_json, out, ": summary.json, report.html")
