"""The benchmark part: written for whoever mills it, judged from its scan, compared with other results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.inspection import datum_faces
from counterflex.cli.commands.program import CellFile, Out
from counterflex.cli.output import keep_inputs, print_summary, progress_bar, say_written
from counterflex.core.result import Lines, ShownTable

_METHODS = ("uncompensated", "catalogue", "identified", "corrected", "online")
benchmark_part = typer.Typer(help="A part that any laboratory can mill, measure and compare.", no_args_is_help=True)


@benchmark_part.command()
def write(out: Out) -> None:
    """Write the benchmark part: program, drawing, tolerances.

    Into DIR: cf1.ngc (G-code), cf1.svg and cf1.pdf (drawing, A4), cf1-tolerances.csv (as `inspect --tolerances` reads
    them).

    Example: `counterflex benchmark-part write --out benchmark-part`
    """
    from counterflex.app.benchmark_part import part

    say_written(out, f"wrote {out}: {', '.join(part.write(out))}")


@benchmark_part.command()
def judge(
    cell: CellFile,
    scan: Annotated[Path, option("--scan", "Scan of the part, as for `inspect`.", arguments.file, "FILE")],
    laboratory: Annotated[str, option("--laboratory", "Who milled it.", metavar="NAME")],
    method: Annotated[
        str,
        option(
            "--method",
            f"How its program was made: {', '.join(_METHODS)}.",
            arguments.one_of(_METHODS, "method"),
            "NAME",
        ),
    ],
    out: Out,
    robot_name: Annotated[
        str | None, option("--robot", "Name of the robot; by default that of the cell.", metavar="NAME")
    ] = None,
    material_name: Annotated[str | None, option("--material", "By default that of the cell.", metavar="NAME")] = None,
    datum: Annotated[
        str, option("--datum", "Faces that place the scan, as for `inspect`.", datum_faces, "FACES")
    ] = "x-,x+,y-,y+,top",
    as_json: Annotated[bool, option("--json", "Print the result as JSON.")] = False,
) -> None:
    """Judge a benchmark part from its scan, by drawing and tolerances.

    Writes into DIR what `inspect` writes, and result.json for `benchmark-part compare`.

    Example: `counterflex benchmark-part judge --cell cell.toml --scan cf1.ply --laboratory A --method online --out out`
    """
    keep_inputs(out, cell, scan)
    from counterflex.app.benchmark_part.judge import BenchmarkConditions, judge as job
    from counterflex.app.inspection.judging import How

    about = BenchmarkConditions(laboratory, method, robot_name, material_name)
    with progress_bar(f"inspecting {scan.name}") as progress:
        result = job(cell, scan, out, about, how=How(datum=datum), progress=progress)
    values = result.model_dump(mode="json")
    table = ShownTable.of(
        f"{result.part}: {result.label}; surface 99.7 %: {result.surface_p997_mm:.3f} mm",
        "feature | quantity | nominal mm:g | tolerance mm:g | worst mm:.3f | "
        "U um (k=2)={uncertainty_um:.1f} | within=held",
        [row | {"held": "yes" if row["within"] else "NO"} for row in values["features"]],
        f"{sum(row.within for row in result.features)} of {len(result.features)} within their tolerance.",
    )
    files = ": result.json, deviations.parquet, report.html, summary.json"
    print_summary(Lines(values, table), as_json, out, files)


@benchmark_part.command()
def compare(
    results: Annotated[list[Path], argument("Files result.json of judge.", arguments.file, "RESULT...")],
    as_json: Annotated[bool, option("--json", "Print the comparison as JSON.")] = False,
) -> None:
    """Compare results of the benchmark part: worst deviation of every feature, um.

    Example: `counterflex benchmark-part compare before/result.json after/result.json`
    """
    from counterflex.app.benchmark_part.judge import compare as job

    answer = job(results)
    labels = [row["label"] for row in answer["results"]]
    rows = [
        [
            row["feature"],
            row["quantity"],
            f"{row['tolerance_um']:g}",
            *(
                f"{value:+.0f}{'' if inside else ' !'}"
                for value, inside in zip(row["deviation_um"], row["within"], strict=True)
            ),
        ]
        for row in answer["features"]
    ]
    rows.append(["all", "within", "", *(f"{row['within']} of {row['of']}" for row in answer["results"])])
    surfaces = (f"{row['surface_p997_mm']:.3f} mm" for row in answer["results"])
    rows.append(["surface", "99.7 %", "", *surfaces])
    title, columns = f"{answer['part']}: deviation from nominal, um", ["feature", "quantity", "tolerance", *labels]
    print_summary(Lines(answer, ShownTable(title, columns, rows, "! outside its tolerance")), as_json)
