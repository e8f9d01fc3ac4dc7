"""Command plan placement: where the part stands in the cell, and the posture there."""

from __future__ import annotations

from typing import Annotated, Any, cast

from counterflex.cli import arguments
from counterflex.cli.arguments import option
from counterflex.cli.commands.program import CellFile, JudgedSurface, Out, Program, ReadingOptions
from counterflex.cli.option_records import with_records
from counterflex.cli.output import keep_inputs, print_summary, progress_bar


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
    table = "candidates.csv, " if summary["chosen"] is not None else ""
    print_summary(summary, False, out, f": cell.toml, {table}summary.json")
