"""Commands that work on a milling program: path, compensate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.option_records import with_records
from counterflex.cli.output import (
    Layers,
    keep_inputs,
    print_json,
    print_part,
    print_table,
    progress_bar,
    say_written,
    warn,
)
from counterflex.core.result import Parts, ShownTable, fill
from counterflex.core.units import UM
from counterflex.programs.language import BY_ENDING, at_prompt, dialects
from counterflex.report.glossary import MODEL, line_of

if TYPE_CHECKING:
    from counterflex.app.inputs import Reading

Program = Annotated[
    Path,
    argument(
        "G-code, Sinumerik (.mpf), APT (.apt), KRL (.src), RAPID (.mod), FANUC TP (.ls), VAL3 (.pgx), Klartext (.h) or "
        "INFORM (.jbi).",
        arguments.file,
        "PROGRAM",
    ),
]
CellFile = Annotated[Path, option("--cell", "Cell file (.toml).", arguments.file, "CELL")]
Out = Annotated[Path, option("--out", "Folder for the results; made when missing.", arguments.output_folder, "DIR")]
Dialect = Annotated[
    str,
    option(
        "--dialect",
        f"Language of the program: {', '.join(dialects())} (that of the file's ending).",
        arguments.one_of(dialects, "dialect"),
    ),
]
Parameters = Annotated[
    Path | None,
    option(
        "--parameters",
        "LinuxCNC parameter file (.var, mm) of the machine it was written for: G28, G30, G53, work offsets.",
        arguments.file,
        "FILE",
    ),
]
AssumeClass = Annotated[
    bool,
    option(
        "--assume-class",
        "Give axes of unknown stiffness the median of the robot's class; marked in everything that comes out.",
    ),
]
WithoutEnd = Annotated[
    bool, option("--without-end", "The program is complete though it stops without M2, M30 or a closing %.")
]


JudgedSurface = Annotated[
    str,
    option(
        "--surface",
        "Surface that must be true: wall (beside the feed), floor (below the tool), both.",
        arguments.one_of(("both", "wall", "floor"), "surface"),
    ),
]


@dataclass(frozen=True)
class MachineOptions:
    """Options by which a program in the language of its ending is read."""

    parameters: Parameters = None
    without_end: WithoutEnd = False

    def reading(self, dialect: str = BY_ENDING) -> Reading:
        """Settings of the reader."""
        from counterflex.app.inputs import Reading

        return Reading(dialect, self.parameters, complete=not self.without_end)


@dataclass(frozen=True)
class ReadingOptions:
    """Options by which a program is read."""

    dialect: Dialect = BY_ENDING
    parameters: Parameters = None
    without_end: WithoutEnd = False

    def reading(self) -> Reading:
        """Settings of the reader."""
        return MachineOptions(self.parameters, self.without_end).reading(self.dialect)


@dataclass(frozen=True)
class ResultOptions:
    """Options that choose what a compensation computes and writes."""

    assume_class: AssumeClass = False
    predict: Annotated[bool, option("--predict/--no-predict", "Predict the path error before and after.")] = True
    report: Annotated[bool, option("--report/--no-report", "Write report.html.")] = True
    programmed_feed: Annotated[
        bool, option("--programmed-feed", "Leave the feed as programmed: for `run --original`, corrected online.")
    ] = False

    def files(self) -> list[str]:
        """Names of what is written beside the program."""
        return ["plan.parquet", "summary.json", *(["report.html"] if self.report else [])]


def path(
    program: Program,
    csv: Annotated[
        Path | None,
        option("--csv", "Write the table to this file instead of printing it.", arguments.output_file, "FILE"),
    ] = None,
    dialect: Dialect = BY_ENDING,
    cell: Annotated[
        Path | None,
        option(
            "--cell", "Cell file (.toml): tools by name, frames, work offsets, rotary machine.", arguments.file, "CELL"
        ),
    ] = None,
    parameters: Parameters = None,
    without_end: WithoutEnd = False,
    as_json: Annotated[bool, option("--json", "Print the motions as JSON.")] = False,
) -> None:
    """List the motions of a program as read: line, end point, feed, arc and orientation of the tool.

    A cell is empty where the program does not say it: an axis that no word has named yet, a place of the machine
    (G53, G28).

    Example: `counterflex path part.ngc --csv path.csv`
    """
    inputs = [program, *(file for file in (cell, parameters) if file is not None)]
    keep_inputs(csv, *inputs, option="--csv")
    from counterflex.app.inputs import Reading
    from counterflex.app.written_out import listed
    from counterflex.programs.listing import listing, write_listing

    toolpath, held = listed(program, Reading(dialect, parameters, complete=not without_end), cell)
    if as_json:
        rows = listing(toolpath, held).to_dicts()
        print_json(
            {"program": toolpath.name, "dialect": toolpath.dialect, "lines": len(toolpath.lines), "motions": rows}
        )
    if csv is None and not as_json:
        typer.echo(listing(toolpath, held).write_csv(), nl=False)
    elif csv is not None:
        count = write_listing(toolpath, csv, held)
        if not as_json:
            say_written(csv, f"wrote {csv}: {count} motions")


@with_records
def compensate(
    program: Program,
    cell: CellFile,
    out: Out,
    language: Annotated[
        str | None,
        option(
            "--as",
            f"Language of the output: {', '.join(at_prompt('write', own=True))}, or one of another package "
            "(`counterflex extensions`); without it that of the program.",
            arguments.one_of(lambda: at_prompt("write"), "language"),
        ),
    ] = None,
    *,
    source: MachineOptions,
    scenario: Layers = None,
    results: ResultOptions,
    as_json: Annotated[bool, option("--json", "Print the summary as JSON.")] = False,
) -> None:
    """Compensate a program: predict force and deflection at each point and write the corrected program.

    Writes into DIR: the program under its own name (or .src/.dat, .mod, .ls, .pgx/.dtx), plan.parquet (every point:
    time, pose, joints, force, deflection, correction, engagement), summary.json and report.html. Either all of them
    or none.

    The feed (F words, $VEL.CP, speeddata) is lowered before first contact, at it and where the path turns, so that
    the arm does not swing ([dynamics] swing_um in the cell file; 0 keeps the feed). What compensation cannot follow
    in time otherwise, a lower feed can: with feed_for_tolerance_um it is lowered there, planned anew up to five
    times. Both are reported with the time they cost.

    Limits of [process_limits] in the cell file (force, spindle torque and power, bending of the tool, torque on each
    axis, deflection, acceleration) lower it too; the one that binds is named line by line.

    A robot program whose loops need another target in each pass is written out first, each motion once; that program
    is then in written-out.

    Table of the scenario: compensation.

    Example: `counterflex compensate part.ngc --cell cell.toml --out out --as krl`
    """
    keep_inputs(out, program, source.parameters)
    from counterflex.files.scenario_file import read_scenario

    wish, table = None, read_scenario(scenario or (), ("compensation",)).compensation
    from counterflex.app import written_out as job
    from counterflex.plan.feed_for_tolerance import FeedTolerance

    if table.feed_for_tolerance_um is not None:
        wish = FeedTolerance(
            table.feed_for_tolerance_um * UM, table.least_feed_percent / 100.0, table.least_chip_um * UM
        )
    with progress_bar(f"compensating {program.name}") as progress:
        summary = job.run(
            program,
            cell,
            out,
            progress=progress,
            language=language,
            reading=source.reading(table.dialect),
            tolerance_m=table.tolerance_um * UM,
            normal_only=table.normal_only,
            feed=wish,
            **asdict(results),
        )
    if as_json:
        print_json(summary)
    else:
        _show(summary, [*summary["files"], *results.files()], out)
        for key, parts in (("feed", _feed_parts), ("feed_limits", _limit_parts)):
            for part in parts(summary[key]) if key in summary else ():
                print_part(part)


def _feed_parts(lowered: dict[str, Any]) -> Parts:
    if lowered["lines"]:
        yield ShownTable.of(
            f"Feed for tolerance, error by the {MODEL}",
            "line=at | feed={feed_percent:g} % | before um:g | after um:g | ={why:not reached: %s}",
            [line | {"at": line_of(line, bare=True)} for line in lowered["lines"]],
        )
    yield f"{MODEL}: " + fill(
        "error {worst_before_um:g} um at the programmed feed, {worst_after_um:g} um now (asked for {tolerance_um:g}); "
        "additional time {extra_s:.1f} s of {time_s:.1f} s, accelerations left out",
        lowered,
    )


def _limit_parts(limited: dict[str, Any]) -> Parts:
    if limited["lines"]:
        yield ShownTable.of(
            "Feed within limits",
            "line=at | feed={feed_percent:g} % | binds=limit | before={before_percent:g} % | "
            "after={after_percent:g} %{lost}",
            [
                line | {"at": line_of(line, bare=True), "lost": "" if line["kept"] else ", not kept: least feed"}
                for line in limited["lines"]
            ],
        )
    yield f"limits of [process_limits]: additional time {limited['extra_s']:g} s"


def _written_rows(written: dict[str, Any]) -> list[list[str]]:
    """Return how much longer the program got, and how far its path is from the planned one."""
    before, after, bound = written["lines_in"], written["lines_out"], written["tolerance_um"]
    error = written.get("largest_written_error_um", written.get("largest_position_error_um", 0.0))
    line = written.get("largest_position_error_line", 0)
    # Words are rounded to their last decimal, and positions with them.
    coarse = error > bound + written.get("resolution_um", 0.0)
    resolution = f"{error:.1f} um {'above' if coarse else 'within'} {bound:g} um"
    return [
        ["Program lines, in and out", f"{before} -> {after}", f"{after / max(1, before):.1f} times"],
        ["Written path off the plan", resolution, f"line {line}" if line and coarse else ""],
    ]


def _show(summary: dict[str, Any], files: Sequence[str], out: Path) -> None:
    from counterflex.app.compensation.headline import error_rows, extrapolation_text
    from counterflex.app.compensation.prediction import calm_feed_text

    prediction = summary["prediction"]
    rows = [list(row) for row in error_rows(prediction)]
    rows += [
        [what, f"{prediction[key]['value']:g} {unit}", prediction[key]["place"]]
        for what, key, unit in (
            ("Peak force", "peak_force_n", "N"),
            ("Peak deflection", "peak_deflection_um", "um"),
            ("Peak correction", "peak_correction_um", "um"),
            ("Peak axial depth", "peak_axial_depth_mm", "mm"),
        )
    ]
    rows += _written_rows(summary["written"])
    print_table(f"{summary['program']} on {summary['cell']}", ["", "value", "where"], rows)
    if slowed := calm_feed_text(summary["calm_feed"]):
        typer.echo(slowed)
    if chips := extrapolation_text(prediction["extrapolation"]):
        typer.echo(chips)
    for collision in prediction["collisions"]:
        typer.echo(f"warning: rapid in {line_of(collision)} cuts {collision['volume_mm3']:.1f} mm3 of material")
    for warning in summary["written"].get("warnings", []):
        warn(warning)
    typer.echo(f"wrote {out}: {', '.join(files)} ({summary['seconds']:.1f} s)")
