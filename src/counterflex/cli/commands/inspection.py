"""The command that judges a real part: ``inspect``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.commands.program import CellFile, Out, Program
from counterflex.cli.output import keep_inputs, print_json, print_table, progress_bar, say_written
from counterflex.core.errors import InputError

_UNITS = ("um", "mm", "cm", "inch", "m")
_FACES = ("x-", "x+", "y-", "y+", "bottom", "top")
_one_face = arguments.one_of(_FACES, "datum face")


def _faces(param: arguments.Param, value: str | None) -> str | None:
    """Check the names of faces before anything is read."""
    if value is not None:
        _one_face(param, [name.strip() for name in value.split(",")])
    return value


def register(app: typer.Typer) -> None:
    """Add this command."""
    app.command()(inspect)


def inspect(
    program: Program,
    cell: CellFile,
    scan: Annotated[
        Path,
        typer.Option(
            "--scan",
            help="Scan of the part: PLY, STL, OBJ, table of x y z, DMIS output, QIF.",
            metavar="FILE",
            callback=arguments.file,
        ),
    ],
    out: Out,
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            help="Unit of the scan: um, mm, cm, inch, m; by default found from the size of the blank.",
            metavar="UNIT",
            callback=arguments.one_of(_UNITS, "unit"),
        ),
    ] = None,
    datum: Annotated[
        str | None,
        typer.Option(
            "--datum",
            help="Faces of the blank that place the scan: some of x-,x+,y-,y+,bottom,top; by default all scanned ones "
            "that the program does not machine.",
            metavar="FACES",
            callback=_faces,
        ),
    ] = None,
    datum_points: Annotated[
        Path | None,
        typer.Option(
            "--datum-points",
            help="Rough pose: lines of scan x,y,z in its unit and part x,y,z in mm, three or more.",
            metavar="FILE",
            callback=arguments.file,
        ),
    ] = None,
    aligned: Annotated[
        bool, typer.Option("--aligned", help="The scan is in the part frame already; it is not moved.")
    ] = False,
    before: Annotated[
        Path | None,
        typer.Option(
            "--before", help="Scan of an earlier part to compare with.", metavar="FILE", callback=arguments.file
        ),
    ] = None,
    nominal: Annotated[
        Path | None,
        typer.Option(
            "--nominal",
            help="CAD mesh in mm, part frame, to judge against in place of what the program makes.",
            metavar="STL",
            callback=arguments.file,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Judge a real part: its scan against the part that the program makes.

    The scan may lie in any pose. It is laid on faces of the blank that the program leaves alone, never on what is to
    be judged. Writes into DIR: deviations.parquet, report.html (map, sections, features), summary.json.

    Example: `counterflex inspect part.ngc --cell cell.toml --scan part.ply --out inspected`
    """
    given = [path for path in (program, cell, scan, datum_points, before, nominal) if path is not None]
    keep_inputs(out, *given)
    if aligned and (datum is not None or datum_points is not None):
        raise InputError(
            "a scan in the part frame is not moved, so that it takes no datum",
            where="--aligned",
            hint="Leave out --aligned, or --datum and --datum-points",
        )
    from counterflex.app.inspection import inspect as job
    from counterflex.app.inspection.judging import How

    how = How(unit, datum, datum_points, aligned)
    with progress_bar(f"inspecting {scan.name}") as progress:
        summary = job.run(program, cell, scan, out, how=how, before=before, nominal=nominal, progress=progress)
    if as_json:
        print_json(summary)
        return
    show(summary)
    say_written(out, f"wrote {out}: deviations.parquet, report.html, summary.json")


def show(summary: dict[str, Any]) -> None:
    """Print the tables of an inspection."""
    names = list(summary["parts"])
    for name in names:
        entry = summary["parts"][name]
        scan, pose = entry["scan"], entry["registration"]
        typer.echo(
            f"{scan['file']}: {scan['points']} points in {scan['unit']}, noise {scan['noise_um']:.1f} um, "
            f"{scan['outliers']} outliers left out; "
            + (
                f"placed by {', '.join(pose['datum_faces'])}, residual {pose['residual_um']:.1f} um, "
                f"condition {pose['condition']:g}"
                if pose["datum_faces"]
                else "taken to be in the part frame"
            )
        )
    print_table(
        f"{summary['program']}: deviation of the measured surface, mm, along the normal",
        ["surface", *(f"{name}: {figure}" for name in names for figure in ("99.7 %", "largest", "rms"))],
        [
            [kind, *(f"{summary['parts'][name][kind][key]:.3f}" for name in names for key in _KEYS)]
            for kind in ("surface", "floor", "wall")
        ],
    )
    if summary["features"]:
        print_table(
            "Features: value furthest from nominal, mm",
            ["feature", "quantity", "nominal", "+-", *(c for name in names for c in (name, "U um", "within"))],
            [
                [row["feature"], row["quantity"], f"{row['nominal_mm']:.3f}", f"{row['tolerance_mm']:g}"]
                + [cell for name in names for cell in _cells(row.get(name))]
                for row in summary["features"]
            ],
            note="U: expanded uncertainty of measurement, k = 2. docs/inspect.md",
        )


_KEYS = ("p997_mm", "max_mm", "rms_mm")


def _cells(entry: dict[str, Any] | None) -> list[str]:
    if entry is None:
        return ["not found", "", ""]
    uncertainty = f"{2.0 * entry['standard_deviation_um']:.0f}"
    return [f"{entry['worst_mm']:.3f}", uncertainty, "yes" if entry["within"] else "no"]
