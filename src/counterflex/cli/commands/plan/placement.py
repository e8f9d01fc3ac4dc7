"""Command plan placement: where the part stands in the cell, and the posture there."""

from __future__ import annotations

from typing import Annotated, Any, cast

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, JudgedSurface, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import (
    EXPECTED_NOTE,
    EXPECTED_UM,
    MODEL,
    MODEL_NOTE,
    MODEL_UM,
    expected_text,
    keep_inputs,
    print_table,
    progress_bar,
    say_written,
)


@with_records
def placement(
    program: Program,
    cell: CellFile,
    out: Out,
    region: Annotated[
        list[str] | None,
        option(
            "--region",
            "Where the part may stand, mm in the robot base: x and y of the middle of the program, z of the part "
            "frame (without it: in front of the robot, from its foot to half its reach). E1=A,B: values that an "
            "external axis may have, mm or deg; may be given again for each.",
            metavar="X0,X1,Y0,Y1,Z0,Z1|NAME=A,B",
        ),
    ] = None,
    turned: Annotated[
        str | None,
        option(
            "--turned",
            "Rotations of the part about z that are allowed, deg from the present one. [default: -180,180]",
            arguments.numbers_of(2),
            "A,B",
        ),
    ] = None,
    candidates: Annotated[
        int, option("--candidates", "Poses of the part that are judged.", min=64, max=100_000)
    ] = 1024,
    mounting: Annotated[
        str | None,
        option(
            "--mounting",
            "Angles at which the spindle can be mounted, besides the present one: an angle of a body of the end "
            "effector, or of tcp. Every angle costs a search.",
            arguments.angles_of_body,
            "BODY.KEY=A,B",
        ),
    ] = None,
    per_operation: Annotated[
        bool,
        option(
            "--per-operation",
            "Choose a place of the external axes for each operation: they move between two, the tool clear of the "
            "blank.",
        ),
    ] = False,
    surface: JudgedSurface = "both",
    *,
    source: ReadingOptions,
) -> None:
    """Choose where the part stands in the cell: smallest error at the machined surface, without chatter.

    A robot is several times stiffer in one place than in another. Poses of the part (x, y, z, rotation about z) are
    searched globally; each is judged by the best posture of the robot along the program, under the predicted cutting
    force: deflection, lost motion of the drives, and the swing behind steps of the force. Refused are poses in which
    the cut feeds a swing, poses out of reach, those that break joint limits or cables, come too close to
    singularities, leave a datum point untouched or bring coarse bodies together.

    Writes into DIR: cell.toml (the cell file with the pose of the part and the posture), candidates.csv (all poses
    judged; those that no other beats in error, time, margin and clearance marked), summary.json.

    In a cell with external axes (rail, positioner) their values are chosen, within the limits of the cell file, and the
    part stays where it is clamped; --region E1=0,2000 searches that axis alone. KRL and RAPID programs hold the values.

    Where the robot holds the part (part_on = "flange") the spindle that stands is placed: its tip in the region, its
    bodies (frame = "tcp") with it.

    With --per-operation every operation gets its own place of rail or positioner: the cell file then says where along
    the program they move, and KRL, RAPID and FANUC programs carry the values.

    With --mounting spindle.b_deg=0,-35 the angle of the spindle is chosen too, one of those that the shop has.

    Example: `counterflex plan placement part.ngc --cell cell.toml --region 900,1800,-400,400,300,1000 --out placement`
    """
    keep_inputs(out, program, cell, source.parameters)
    box, axes = arguments.region(region or [], "--region")
    angles = arguments.numbers(turned, "--turned", 2)
    from counterflex.app.placement import operations_job, placement as job
    from counterflex.app.placement.region import Mounting, Wish
    from counterflex.core.errors import InputError
    from counterflex.plan.posture.cut_path import Surface

    if per_operation and mounting is not None:
        raise InputError(
            "--mounting and --per-operation are chosen one after the other", value="both",
            hint="Choose the mounting first, then the places with the cell file that it writes",
        )  # fmt: skip
    options: dict[str, Any] = {
        "reading": source.reading(),
        "surface": cast("Surface", surface),
        "wish": Wish(box, None if angles is None else tuple(angles), axes or None),
        "count": candidates,
    }
    with progress_bar(f"searching the place for {program.name}") as progress:
        if per_operation:
            summary = operations_job.run(program, cell, out, progress=progress, **options)
        else:
            mounted = None if mounting is None else Mounting(*arguments.body_angles(mounting, "--mounting"))
            summary = job.run(program, cell, out, mounting=mounted, progress=progress, **options)
    if summary["chosen"] is not None:
        _show(summary)
    if per_operation:
        _show_operations(summary)
    table = "candidates.csv, " if summary["chosen"] is not None else ""
    say_written(out, f"wrote {out}: cell.toml, {table}summary.json")


def _show(summary: dict[str, Any]) -> None:
    axes = summary["external_axes"]
    columns = ["place", "x mm", "y mm", "z mm", "a deg", *axes, "branch", "rotation deg", EXPECTED_UM, MODEL_UM]
    columns += ["with lost motion um", "damping in cut", "reversals", "limit margin deg", "wrist deg", "clearance mm"]
    note = (
        f"Deflection at rest, not compensated: 99.7 % of the cut stay below it. {EXPECTED_NOTE} With lost motion: "
        "power mean of the error with lost motion and swing, by the model too."
    )
    print_table(
        f"{summary['program']} on {summary['cell']}",
        columns,
        [[name, *_row(summary[name], axes)] for name in ("present", "posture_alone", "chosen")],
        note=note,
    )
    for row in summary.get("mountings", []):
        typer.echo(_angle(row, summary["mounting"]))
    if summary["reduction_percent"] is not None:
        typer.echo(f"{summary['reduction_percent']:g} % less deflection than in the present place and posture")
    refused = ", ".join(f"{count} {reason}" for reason, count in summary["refused"].items())
    typer.echo(f"{summary['candidates']} places judged in {summary['search_s']:g} s; refused: {refused or 'none'}")


def _show_operations(summary: dict[str, Any]) -> None:
    """Places of the operations, and what they gain."""
    axes, whole = summary["external_axes"], summary["per_operation"]
    rows = [
        [
            f"{row['lines'][0]}-{row['lines'][1]}", f"{row['cut_mm']:g}", *(f"{row[name]:g}" for name in axes),
            f"{row['error_um']:g}", "" if row["in_one_place_um"] is None else f"{row['in_one_place_um']:g}",
        ]
        for row in summary["operations"]
    ]  # fmt: skip
    print_table(
        "Operations", ["lines", "cut mm", *axes, MODEL_UM, "in one place um"], rows,
        note=f"One posture for all: {whole['branch']}, {whole['rotation_about_tool_deg']:g} deg about the tool. "
        f"{MODEL_NOTE}",
    )  # fmt: skip
    if whole["in_one_place_um"] is None:
        typer.echo(f"one place for all cannot be run ({summary.get('one_place_refused', 'in this posture')})")
    else:
        typer.echo(
            f"{whole['moves']} moves between operations, {MODEL}: {whole['error_um']:g} um of error, "
            f"{whole['reduction_percent']:g} % less than {whole['in_one_place_um']:g} um in the best place for all"
        )


def _angle(row: dict[str, Any], made: dict[str, Any]) -> str:
    """One angle of the spindle: its best place, or why there is none."""
    worth = (
        row["refused"] if row["deflection_um"] is None else f"{row['deflection_um']:g} um in its best place ({MODEL})"
    )
    marks = [word for word in ("present", "chosen") if row["angle_deg"] == made[f"{word}_deg"]]
    remark = f" ({', '.join(marks)})" if marks else ""
    return f"{made['body']}.{made['key']} = {row['angle_deg']:g}: {worth}{remark}"


def _row(held: dict[str, Any] | None, axes: list[str]) -> list[str]:
    keys = [
        "x_mm",
        "y_mm",
        "z_mm",
        "a_deg",
        *axes,
        "branch",
        "rotation_about_tool_deg",
        "expected",
        "deflection_um",
        "error_um",
    ]
    keys += ["damping_in_cut", "reversals", "limit_margin_deg", "wrist_deg", "clearance_mm"]
    if held is None:
        return ["out of reach", *[""] * (len(keys) - 1)]
    held = held | {"expected": expected_text(held)}
    values = [held[key] for key in keys]
    return ["" if v is None else v if isinstance(v, str) else f"{v:g}" for v in values]
