"""Commands that repeat published experiments on the simulated cell, over sockets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.commands.prove import FamilyName, Seeds, Workers
from counterflex.cli.output import print_json, print_made_again, print_table, resumable_progress

if TYPE_CHECKING:
    from counterflex_lab.reproduce.experiment import Experiment

Out = Annotated[
    Path, typer.Option("--out", help="Folder for the results.", metavar="DIR", callback=arguments.output_folder)
]
Json = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]


def groove(
    out: Out,
    seeds: Seeds = "1001-1005",
    level: Annotated[
        str,
        typer.Option(
            "--level",
            help="identified: each simulated cell is measured first; catalogue: the cell file as it is.",
            callback=arguments.one_of(("identified", "catalogue"), "level"),
        ),
    ] = "identified",
    quick: Annotated[
        bool, typer.Option("--quick", help="One truth, payload only, straight edge: does it work at all?")
    ] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """A groove of 547 N corrected from force, with pilot control, and by plan and rest (Haehn and Weigold 2020).

    Straight and 40 degree exit edge, Cartesian and axis-specific corrections, each run in lockstep over RSI and Net F/T
    and judged by where the simulated tool truly was. Interrupted, the same command goes on where it was.

    Example: `counterflex reproduce groove --out groove`
    """
    numbers = arguments.seeds(seeds)
    from counterflex_lab.reproduce.haehn import Groove

    _done(Groove(out, seeds=numbers, level=level, quick=quick, workers=workers), _show_groove, as_json)


def _done(experiment: Experiment, show: Callable[[dict[str, Any]], None], as_json: bool) -> None:
    with resumable_progress(experiment.name, experiment.folder) as progress:
        summary = experiment.run(progress)
    if as_json:
        print_json(summary)
        return
    show(summary)
    print_made_again(summary)
    typer.echo(f"wrote {experiment.folder}")


def _show_groove(summary: dict[str, Any]) -> None:
    from counterflex_lab.reproduce import haehn_report as report
    from counterflex_lab.reproduce.way import REFUSED

    edges = list(dict.fromkeys(row["edge"] for row in summary["seeds"]))
    print_table(
        f"Largest error across the feed, mm: median / worst of {len({r['seed'] for r in summary['seeds']})} truths"
        f" ({summary['truth_level']})",
        ["variant", *(f"{edge} {figure}" for edge in edges for figure in ("path", "exit")), "Haehn2020", "runs"],
        report.table_rows(summary),
    )
    if any(item["refused"] for item in summary["variants"].values()):
        typer.echo(REFUSED)
    typer.echo(report.verdict(summary))


def paths(
    out: Out,
    seeds: Seeds = "1001-1003",
    quick: Annotated[bool, typer.Option("--quick", help="Small paths and one seed: does it work at all?")] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Square and circle with a laser tracker in the loop: off, the published integrator, the designed controller.

    A 400 mm square and a circle of 150 mm radius at 700 mm/min (Mandiola 2023), each run in lockstep over sockets and
    judged by where the simulated tool truly was. Interrupted, the same command goes on where it was.

    Example: `counterflex reproduce paths --out paths`
    """
    numbers = arguments.seeds(seeds)
    from counterflex_lab.reproduce.mandiola import Paths

    _done(Paths(out, seeds=numbers, quick=quick, workers=workers), _show_paths, as_json)


def _show_paths(summary: dict[str, Any]) -> None:
    from counterflex_lab.reproduce import mandiola_report as report

    print_table("True error of the tool", list(report.COLUMNS), report.figure_rows(summary))
    columns, rows = report.paper_comparison(summary)
    print_table("Beside the paper, worst truth", columns, rows)
    print_table(
        "Reduction against off (Mandiola2023: circle 66 %), and corner peak against the published gain's",
        ["seed", "controller", "circle contour %", "circle total %", "straights total %", "corner peak ratio"],
        [
            [
                str(item["seed"]),
                name,
                *(
                    f"{100.0 * item[name][key]:.1f}"
                    for key in ("circle_contour_rms", "circle_total_rms", "square_total_rms")
                ),
                f"{item[name]['corner_peak_to_published']:.2f}",
            ]
            for item in summary["reductions"]
            for name in item
            if name != "seed"
        ],
    )
    print_table("Margins on the robot of the cell file", list(report.MARGIN_COLUMNS), report.margin_rows(summary))
    typer.echo(report.verdict(summary))
    missed = [name.replace("_", " ") for name, goal in summary["goals"].items() if not goal["reached"]]
    if missed:
        typer.echo("goals missed: " + ", ".join(missed))


def online(
    out: Out,
    seeds: Seeds = "1001-1003",
    family: FamilyName = "wide",
    quick: Annotated[
        bool, typer.Option("--quick", help="One truth, its payload identified, worn tool only: does it work at all?")
    ] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """A groove whose plan is wrong as plans are wrong, corrected by force, pilot control, hybrid, tracker and all.

    Worn tool, another alloy, a higher blank, a softer robot, an arm that drifted, a longer tool: each run in lockstep
    over RSI, Net F/T and a tracker's datagrams on identified cells, and judged by where the simulated tool truly was.
    Interrupted, the same command goes on where it was.

    Example: `counterflex reproduce online --out online`
    """
    numbers = arguments.seeds(seeds)
    from counterflex.twin.truth.family import family_of
    from counterflex_lab.reproduce.online import WrongPlans

    job = WrongPlans(out, seeds=numbers, family=family_of(family), quick=quick, workers=workers)
    _done(job, _show_online, as_json)


def _show_online(summary: dict[str, Any]) -> None:
    from counterflex_lab.reproduce import online_report as report
    from counterflex_lab.reproduce.online_case import WAYS
    from counterflex_lab.reproduce.way import REFUSED

    count = len({row["seed"] for row in summary["seeds"]})
    about = f"median / worst of {count} truths ({summary['family']}, {summary['truth_level']})"
    for title, kind in (
        (f"Path error, 99.7 %, mm: {about}", "p997_mm"),
        (f"Largest path error, mm: {about}", "max_mm"),
        ("Restored of what the wrong plan loses, %: median / worst", "restored"),
    ):
        print_table(title, ["what is wrong", *WAYS], report.table_rows(summary, kind))
    if any(item["refused"] for row in summary["rows"].values() for item in row.values()):
        typer.echo(REFUSED)
    typer.echo(report.verdict(summary))


def holder(
    out: Out,
    seeds: Seeds = "1001-1003",
    family: FamilyName = "wide",
    level: Annotated[
        str,
        typer.Option(
            "--level",
            help="identified: each simulated cell is measured first; catalogue: its holder only.",
            callback=arguments.one_of(("identified", "catalogue"), "level"),
        ),
    ] = "identified",
    quick: Annotated[
        bool, typer.Option("--quick", help="One truth, its holder identified: does it work at all?")
    ] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """An edge milled by the force of the strain-gauge holder, without and with a plan (Denkena2015, Fig. 1).

    The validation cut of the paper, the bridges where the holder's drawing says that they tell the force best. Each run
    in lockstep over RSI and strain datagrams; part and force are judged by the simulated cell. Interrupted, the same
    command goes on where it was.

    Example: `counterflex reproduce holder --out holder --seeds 1001-1003`
    """
    numbers = arguments.seeds(seeds)
    from counterflex.twin.truth.family import family_of
    from counterflex_lab.reproduce.holder import Edge

    job = Edge(out, seeds=numbers, family=family_of(family), level=level, quick=quick, workers=workers)
    _done(job, _show_holder, as_json)


def _show_holder(summary: dict[str, Any]) -> None:
    from counterflex_lab.reproduce.holder import DIRECTIONS, table_rows

    count = len(summary["seeds"])
    print_table(
        f"Path error, mm, and error of the force, N (95 % half width): median / worst of {count} truths "
        f"({summary['family']}, {summary['truth_level']}); Denkena2015: 10, 10, 50 N",
        ["way", "path p99.7", "largest", "entry", *DIRECTIONS, "runs"],
        table_rows(summary),
    )
    goal = summary["goal"]
    worst = "no run" if goal["worst_n"] is None else f"{goal['worst_n']:.1f} N"
    typer.echo(f"axial force within {goal['axial_n']:g} N: {worst} ({'met' if goal['met'] else 'missed'})")
