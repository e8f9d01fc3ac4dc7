"""Commands that answer a small question: robots, pose, deflection, cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, numbers, option
from counterflex.cli.commands.cell_import import cell_import
from counterflex.cli.output import print_json, print_part, print_summary, print_table
from counterflex.core.errors import InputError
from counterflex.core.jit import few_calls
from counterflex.core.next_command import next_command
from counterflex.core.result import ShownTable

_GROUPS = ("geometry", "stiffness_about_axes", "masses")
AsJson = Annotated[bool, option("--json", "Print JSON instead of a table.")]
Target = Annotated[
    str, argument("A robot of the catalogue, or a cell file (.toml).", arguments.robot_or_cell, "ROBOT|CELL")
]


def robots(
    name: Annotated[
        str | None, argument("Show one robot as its data sheet does, with the source of every number; or a cell file.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the robots of the catalogue and how far their numbers can be trusted.

    VERIFIED: two independent sources agree. SECONDARY: one source. UNVERIFIED: from memory or derived.

    Example: `counterflex robots kuka_kr300_r2500_ultra`
    """
    from counterflex.app import robot_list

    if name is not None:
        sheet = robot_list.data_sheet(robot_list.robot_named(name))
        rows = [row for row in robot_list.robots() if row["name"] == name] or [{"name": name}]
        rows[0]["data_sheet"] = sheet
        if as_json:
            print_json(rows)
        else:
            _print_robot(name, rows[0], sheet)
        return
    rows = robot_list.robots()
    if as_json:
        print_json(rows)
        return
    status = "".join(f" | {name.replace('_', ' ')}=status[{name}]?~not known" for name in _GROUPS)
    note = "counterflex robots NAME shows where each number comes from."
    print_part(ShownTable.of("Robots", f"name | model | reach mm:g | payload kg:g{status}", rows, note))


def _print_robot(name: str, row: dict[str, Any], sheet: dict[str, Any]) -> None:
    """Lengths, limits, zero posture, then the source of every number."""
    title = row.get("model", name)
    if sheet["lengths_mm"]:
        lengths = [[what, f"{value:g}"] for what, value in sheet["lengths_mm"].items()]
        print_table(f"{title}: lengths", ["from .. to", "mm"], lengths)
    axes = [
        [axis["axis"], f"{axis['low_deg']:g}", f"{axis['high_deg']:g}", _number(axis["speed_deg_s"])]
        for axis in sheet["axes"]
    ]
    print_table("Axes as the controller shows them", ["axis", "least deg", "most deg", "deg/s"], axes)
    typer.echo(f"Controller: {sheet['controller']}. Axis 3 is counted {sheet['axis_3']}. World: {sheet['world']}.")
    between = sheet["axis_3_against_upper_arm_deg"]
    if sheet["coupled"]:
        limits = "not stated" if between is None else f"{between[0]:g} to {between[1]:g} deg"
        typer.echo(f"Limit of axis 3 against the upper arm: {limits}.")
    if sheet["assumed"]:
        typer.echo(f"Assumed: {sheet['assumed']}.")
    zero = ", ".join(f"{key} {value:g}" for key, value in sheet["at_zero"].items())
    typer.echo(f"Flange in the world with all axes at zero: {zero}.")
    if "status" in row:
        table = [[group, status, row["source"][group]] for group, status in row["status"].items()]
        print_table(f"{title} ({name})", ["numbers", "status", "source"], table)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def pose(
    target: Target,
    joints_deg: Annotated[
        str | None,
        option("--joints-deg", "Six joint angles as the controller shows them.", arguments.numbers_of(6), "A1,..,A6"),
    ] = None,
    xyz_mm: Annotated[
        str | None, option("--xyz-mm", "TCP position in the robot base.", arguments.numbers_of(3), "X,Y,Z")
    ] = None,
    abc_deg: Annotated[
        str, option("--abc-deg", "TCP orientation, intrinsic z-y'-x'' (KUKA A,B,C).", arguments.numbers_of(3), "A,B,C")
    ] = "0,0,0",
    as_json: AsJson = False,
) -> None:
    """Where is the TCP for these joint angles, or which joint angles bring it to a pose (all branches).

    Forth and back:

    `counterflex pose kuka_kr300_r2500_ultra --joints-deg 0,-90,90,0,0,0`

    `counterflex pose kuka_kr300_r2500_ultra --xyz-mm 1590,0,1784 --abc-deg 0,90,0`
    """
    from counterflex.app import pose_questions

    joints, xyz = numbers(joints_deg, "--joints-deg", 6), numbers(xyz_mm, "--xyz-mm", 3)
    if (joints is None) == (xyz is None):
        number = "both" if joints is not None else "neither"
        raise InputError(
            "use either --joints-deg or --xyz-mm",
            value=number,
            hint="--joints-deg gives the pose, --xyz-mm the joint angles",
        )
    chain = pose_questions.chain_of(target)
    with few_calls():
        if joints is not None:
            answer = pose_questions.pose_of_joints(chain, joints)
        else:
            answer = pose_questions.joints_of_pose(chain, xyz or [], numbers(abc_deg, "--abc-deg", 3) or [])
    print_summary(answer, as_json)


def deflection(
    target: Target,
    joints_deg: Annotated[str, option("--joints-deg", "Six joint angles.", arguments.numbers_of(6), "A1,..,A6")],
    force_n: Annotated[
        str, option("--force-n", "Force on the tool at the TCP, base axes.", arguments.numbers_of(3), "FX,FY,FZ")
    ] = "0,0,0",
    moment_nm: Annotated[
        str, option("--moment-nm", "Moment on the tool about the TCP, base axes.", arguments.numbers_of(3), "MX,MY,MZ")
    ] = "0,0,0",
    as_json: AsJson = False,
) -> None:
    """Deflection of the tool under a load: linear, nonlinear, own-weight sag, compliance matrix, share of each element.

    Example: `counterflex deflection cell.toml --joints-deg 0,-95,125,0,-30,0 --force-n 0,500,0`
    """
    from counterflex.app import questions

    chain, _ = questions.load_chain(target)
    with few_calls():
        answer = questions.deflection(
            chain,
            numbers(joints_deg, "--joints-deg", 6) or [],
            numbers(force_n, "--force-n", 3) or [],
            numbers(moment_nm, "--moment-nm", 3) or [],
        )
    print_summary(answer, as_json)


def cell_check(
    cell: Annotated[Path, argument("The cell file.", arguments.file, "CELL")],
    program: Annotated[
        Path | None, option("--program", "G-code file in whose cut the unknowns are judged.", arguments.file, "PROGRAM")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a cell file: units, plausibility, reach, the weakest element, and what is not known by what it costs in mm.

    Example: `counterflex cell check cell.toml`
    """
    from counterflex.app import questions

    with few_calls(program is None):
        answer = questions.check_cell(str(cell), program)
    print_summary(answer, as_json)


def cell_example(
    out: Annotated[Path, option("--out", "Where to write it; an existing file is kept.", arguments.output_file)] = Path(
        "cell.toml"
    ),
    robot: Annotated[
        str | None,
        option(
            "--robot",
            "Another robot of the catalogue (`counterflex robots`), with the same spindle, tools and part.",
            metavar="NAME",
        ),
    ] = None,
) -> None:
    """Write the demonstration cell (KR 300 with a spindle) as an example, with files to try it.

    Beside NAME.toml: its test part part.ngc, for a KUKA an RSI configuration rsi.xml, and NAME-small.toml with
    groove.ngc, a small blank for quick trials.

    Example: `counterflex cell example --out cell.toml`
    """
    from counterflex.app import examples

    for path in examples.write_all(out, examples.ROBOT if robot is None else robot):
        typer.echo(f"wrote {path}")
    if robot not in (None, examples.ROBOT):
        typer.echo(
            "the part stands where it suits the KR 300; choose its place: "
            + next_command(
                "plan placement", out.with_name("groove.ngc"), cell=out.with_stem(f"{out.stem}-small"), out="placed"
            )
        )


cell = typer.Typer(no_args_is_help=True, help="Write, check and explain cell files.")
cell.command("check")(cell_check)
cell.command("example")(cell_example)
cell.command("import")(cell_import)
