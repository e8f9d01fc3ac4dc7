"""Commands that answer a small question: robots, pose, deflection, cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, numbers, option
from counterflex.cli.commands.cell_import import cell_import
from counterflex.cli.output import print_json, print_table, warn
from counterflex.core.errors import InputError
from counterflex.core.jit import few_calls
from counterflex.core.next_command import next_command
from counterflex.report.glossary import MODEL_NOTE

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
    else:
        print_table(
            "Robots",
            ["name", "model", "reach mm", "payload kg", "geometry", "stiffness about axes", "masses"],
            [
                [
                    row["name"],
                    row["model"],
                    _number(row["reach_mm"]),
                    _number(row["payload_kg"]),
                    row["status"].get("geometry", "not known"),
                    row["status"].get("stiffness_about_axes", "not known"),
                    row["status"].get("masses", "not known"),
                ]
                for row in rows
            ],
            note="counterflex robots NAME shows where each number comes from.",
        )


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
    if joints is not None:
        with few_calls():
            answer = pose_questions.pose_of_joints(chain, joints)
        if as_json:
            print_json(answer)
        else:
            tcp = answer["tcp_in_base"]
            print_table(f"TCP of {chain.name} in its base", list(tcp), [[f"{value:.4f}" for value in tcp.values()]])
            print_table("Margin to the joint limits, deg", *_row(answer["margins"]))
        return
    with few_calls():
        answer = pose_questions.joints_of_pose(chain, xyz or [], numbers(abc_deg, "--abc-deg", 3) or [])
    if as_json:
        print_json(answer)
        return
    print_table(
        f"{len(answer['solutions'])} ways for {chain.name} to be there",
        ["branch", *(f"A{i} deg" for i in range(1, 7)), "smallest margin deg", "wrist deg"],
        [
            [
                solution["branch"],
                *(f"{angle:.4f}" for angle in solution["joints_deg"]),
                f"{min(solution['margins'].values()):.2f}",
                f"{solution['wrist_deg']:.2f}",
            ]
            for solution in answer["solutions"]
        ],
        note="wrist: how far axis 5 is from the wrist singularity.",
    )


def _row(values: dict[str, float]) -> tuple[list[str], list[list[str]]]:
    return list(values), [[f"{value:.2f}" for value in values.values()]]


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
    if as_json:
        print_json(answer)
        return
    rows = [
        [what, *(f"{v:.2f}" for v in answer[key]["dx_dy_dz_um"]), f"{answer[key]['length_um']:.2f}"]
        + [f"{v:.2f}" for v in answer[key]["rx_ry_rz_urad"]]
        for what, key in (("linear", "linear"), ("nonlinear", "nonlinear"), ("own weight (sag)", "gravity_sag"))
    ]
    columns = ["", "dx um", "dy um", "dz um", "length um", "rx urad", "ry urad", "rz urad"]
    print_table(
        f"Deflection of the TCP of {chain.name}, base axes",
        columns,
        rows,
        note=f"Linear and nonlinear differ by {answer['gap_um']:.3f} um. {MODEL_NOTE}",
    )
    matrix = answer["compliance"]["translation_um_per_kn"]
    print_table(
        "Compliance, um/kN (base axes)",
        ["", "Fx", "Fy", "Fz"],
        [[name, *(f"{value:.1f}" for value in row)] for name, row in zip(("dx", "dy", "dz"), matrix, strict=True)],
    )
    print_table(
        "Share of each element",
        ["segment", "dx um", "dy um", "dz um", "share"],
        [_share(row) for row in answer["shares"]],
    )
    for warning in answer["warnings"]:
        warn(warning)


def _share(row: dict[str, Any]) -> list[str]:
    return [row["segment"], *(f"{value:.1f}" for value in row["dx_dy_dz_um"]), f"{100 * row['share']:.1f}%"]


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
    if as_json:
        print_json(answer)
        return
    print_table(
        f"{answer['cell']}: elastic chain, {answer['mass_kg']:g} kg",
        ["segment", "compliance", "mass kg"],
        [
            [
                row["segment"],
                "  ".join(f"{key} {value:g}" for key, value in row["compliance"].items()) or "rigid",
                f"{row['mass_kg']:g}",
            ]
            for row in answer["segments"]
        ],
    )
    if answer["at_corner"] is not None:
        print_table(
            f"Compliance at the corner of the stock {answer['at_corner']['xyz_mm']} mm",
            ["direction", "um/N", "weakest element", "its share"],
            [
                [row["direction"], f"{row['um_per_n']:.2f}", row["weakest"], f"{100 * row['share']:.0f}%"]
                for row in answer["softness"]
            ],
            note=f"Own-weight sag varies by {answer['sag_variation_um']:.0f} um over the stock. "
            f"Smallest joint margin {answer['smallest_joint_margin_deg']:.1f} deg.",
        )
    if answer["identified"]:
        print_table(
            "Identified from measurements",
            ["recipe", "date", "data", "error on held-out data", "values determined", "not determined"],
            [
                [entry["recipe"], entry["date"], ", ".join(entry["data"]), entry["holdout"], *_seen(entry["values"])]
                for entry in answer["identified"]
            ],
            note=f"Values with their standard deviations: {next_command('cell check', 'CELL', json=True)}",
        )
    if answer["unknowns"] is not None:
        _show_unknowns(answer["unknowns"])
    for assumption in answer["assumptions"]:
        typer.echo(f"note: {assumption}")
    for warning in answer["warnings"]:
        warn(warning)
    typer.echo("cell file ok" if not answer["warnings"] else f"cell file readable, {len(answer['warnings'])} warnings")


def _show_unknowns(unknowns: dict[str, Any]) -> None:
    """Print what is not known, by what it leaves, and what to measure first."""
    print_table(
        f"Not known, by what it leaves uncorrected {unknowns['where']}",
        ["unknown", "known from", "leaves mm", "90 % of cells, mm", "measure"],
        [
            [
                row["unknown"],
                row["known_from"],
                "" if row["leaves_mm"] is None else f"{row['leaves_mm']:.2f}",
                "not at rest"
                if row["of_90_percent_mm"] is None
                else f"{row['of_90_percent_mm'][0]:.2f} to {row['of_90_percent_mm'][1]:.2f}",
                row["measure"],
            ]
            for row in unknowns["rows"]
        ],
    )
    first = unknowns["measure_first"]
    if first is not None:
        typer.echo(f"measure first: {first['command']} ({first['removes_mm']:.2f} mm, up to {first['up_to_mm']:.2f})")


def _seen(values: list[dict[str, Any]]) -> tuple[str, str]:
    """Return how many values the data see, and how many stayed as they were known before."""
    unseen = sum(value["seen"] == "prior" for value in values)
    return str(len(values) - unseen), str(unseen)


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
