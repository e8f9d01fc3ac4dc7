"""The command that starts a cell file from what a controller knows: ``cell import``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.output import print_summary
from counterflex.core.result import Lines, Part, PlainLine, ShownTable
from counterflex.core.units import DEG, MM


def cell_import(
    files: Annotated[
        list[Path],
        argument(
            "$config.dat of a KUKA, modules and MOC.cfg of an ABB, or JSON of a RoboDK station.",
            arguments.file,
            "FILE...",
        ),
    ],
    robot: Annotated[str, option("--robot", "Robot of the catalogue: counterflex robots.", arguments.robot, "NAME")],
    out: Annotated[
        Path, option("--out", "Cell file to write; an existing file is kept.", arguments.output_file)
    ] = Path("cell.toml"),
    tool: Annotated[
        str, option("--tool", "Tool of the controller (where there is one: that one).", arguments.frame_name)
    ] = "",
    base: Annotated[str, option("--base", "Base that is the part frame (likewise).", arguments.frame_name)] = "",
    poses: Annotated[
        Path | None,
        option(
            "--poses",
            "Table q1_deg..q6_deg, x_mm..c_deg, tool, base of poses that the controller shows: they must fit.",
            arguments.file,
            "CSV",
        ),
    ] = None,
    tolerance_mm: Annotated[float, option("--tolerance-mm", "Of the poses.", min=0.001, max=100.0)] = 0.5,
    tolerance_deg: Annotated[float, option("--tolerance-deg", "Of the poses.", min=0.001, max=10.0)] = 0.05,
    as_json: Annotated[bool, option("--json", "Print what was imported as JSON.")] = False,
) -> None:
    """Start a cell file from tool, base and load data of a controller, and hold them against poses that it shows.

    The robot is that of the catalogue; what a controller does not know (compliances, blank, tools, material) is yours
    to add. Where forward kinematics does not lead to a pose, the message says by how much and which frame is off.

    Example: `counterflex cell import '$config.dat' --robot kuka_kr300_r2500_ultra --tool 1 --base 1 --out cell.toml`
    """
    from counterflex.app.controller_import import job

    answer = job.run(
        files, out, robot, tool=tool, base=base, poses=poses, tolerance_m=tolerance_mm * MM,
        tolerance_rad=tolerance_deg * DEG,
    )  # fmt: skip
    parts: list[Part] = [PlainLine(f"note: {note}") for note in answer["notes"]]
    if answer["poses"]:
        columns = "tool=0 | base=1 | poses=2 | rms mm=3 | largest mm=4 | largest deg=5 | in line=6"
        rows = [tuple(map(str, row.values())) for row in answer["poses"]]
        parts[:0] = [ShownTable.of("Forward kinematics against the poses that the controller shows", columns, rows)]
    written = "wrote {cell}: tool {tool} and base {base} of a {controller} controller"
    print_summary(Lines(answer, *parts, written), as_json)
