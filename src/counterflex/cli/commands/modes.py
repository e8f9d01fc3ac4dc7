"""Command modes: natural frequencies and mode shapes of a cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, numbers, option
from counterflex.cli.output import keep_inputs, print_json, print_table, progress_bar, say_written


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
    if as_json:
        print_json(summary)
        return
    _show(summary)
    say_written(out, f"wrote {out}: summary.json, report.html")


def _show(summary: dict[str, Any]) -> None:
    rows = [
        [
            f"{row['hz']:.2f}",
            "{:.1f} to {:.1f}".format(*row["of_90_percent_hz"]),
            f"{row['damping_ratio']:.3f}",
            ", ".join(f"{value:+.2f}" for value in row["tip_direction"]),
            f"{100.0 * row['share_of_compliance']:.0f} %",
            ", ".join(f"{one['name']} {100.0 * one['share']:.0f} %" for one in row["springs"]),
        ]
        for row in summary["modes"]
    ]
    angles = ", ".join(f"{angle:g}" for angle in summary["joints_deg"])
    print_table(
        f"Modes of {summary['cell']} at {angles} deg",
        ["Hz", "90 % of cells", "damping", "tip moves along (base)", "of compliance", "springs (strain energy)"],
        rows,
        note=f"{summary['masses']}; drives: {summary['drives']}; damping: {summary['damping']}",
    )
    if summary["with_drives"]:
        listed = ", ".join(f"{row['hz']:.2f} Hz ({row['damping_ratio']:.2f})" for row in summary["with_drives"])
        typer.echo(f"with the drives on: {listed}")
    if "tap_test" in summary:
        _show_tap_test(summary["tap_test"])


def _show_tap_test(tap: dict[str, Any]) -> None:
    rows = [
        [
            row["body"],
            f"{row['stated_kg']:.1f}",
            f"{row['fitted_kg']:.1f}",
            f"{row['sigma_percent']:.0f} %",
            "yes" if row["seen"] else "no: as stated",
        ]
        for row in tap["masses"]
    ]
    before, after = (
        ", ".join(f"{mode['hz']:.2f} Hz ({mode['damping_ratio']:.3f})" for mode in tap[name])
        for name in ("modes_before", "modes_after")
    )
    print_table(
        f"Tap test {tap['file']}, {tap['rows']} rows up to {tap['up_to_hz']:g} Hz",
        ["body", "stated kg", "fitted kg", "sigma", "seen by the data"],
        rows,
        note=f"all stiffnesses times {tap['stiffness_factor']:.3f}; FRAC {tap['frac_before']:.3f} before, "
        f"{tap['frac_after']:.3f} after",
    )
    typer.echo(f"modes before: {before}")
    typer.echo(f"modes after:  {after}")
