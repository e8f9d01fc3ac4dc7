"""Command that starts a simulated KUKA controller by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, option
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.simulated.options import (
    Fault,
    RecordFile,
    print_start,
    refused_lines,
    reply_lines,
    require_not_abandoned,
)
from counterflex.cli.output import Layers, host_port, keep_inputs, print_summary, progress_bar
from counterflex.core.errors import InputError
from counterflex.core.result import Lines, fill


def rsi(
    rsi: Annotated[Path, argument("ETHERNET configuration file of the RSI context (.xml).", arguments.file, "RSI")],
    program: Annotated[
        Path | None, option("--program", "G-code that the robot runs, with --cell.", arguments.file, "PROGRAM")
    ] = None,
    cell: Annotated[
        Path | None, option("--cell", "Cell file: robot, tool and part as the controller has them.", arguments.file)
    ] = None,
    seconds: Annotated[float | None, option("--seconds", "How long; 10 s without a program.", min=0.01)] = None,
    scenario: Layers = None,
    fault: Fault = None,
    record: RecordFile = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a KUKA controller: it sends RSI telegrams, applies the answers as a real one does, and reports.

    It runs a program or stands still; no physics, no instruments. It prints the effect on the robot: largest correction
    and step, late and refused answers, the age of the applied correction, and the reason for the end.

    Exit status: 0 the program or the time ended, or an answer stopped the robot; 2 refused, or nobody ever answered;
    3 nobody answered any more.

    Tables of the scenario: controller, rsi, standstill, faults.

    Example: `counterflex twin rsi rsi.xml --seconds 5 --fault lost=0.05,direction=in --record applied.csv`
    """
    keep_inputs(record, rsi, program, cell, option="--record")
    if program is not None and cell is None:
        raise InputError("a program needs the cell it runs in", value=program.name, hint="Give --cell")
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("controller", "rsi", "standstill"))
    place = trial.standstill.pose_mm_deg
    if cell is not None and program is None and place is not None:
        raise InputError(
            "where a robot of a cell stands follows from its axis angles",
            where="standstill.pose_mm_deg",
            value=list(place),
            hint="Give standstill.joints_deg instead, or leave out --cell",
        )
    import numpy as np

    from counterflex.app.run.robot_links import ROBOT_LINKS
    from counterflex.app.simulated_cell import scenario as shown
    from counterflex.app.simulated_cell.alone import Watched
    from counterflex.core.registry import imported
    from counterflex.core.units import DEG

    settings: dict[str, Any] = {
        "rsi": rsi,
        "program": program,
        "cell": cell,
        "T_part_tcp": shown.matrix((0.0,) * 6 if place is None else place),
        "q": np.array(trial.standstill.joints_deg) * DEG,
        "seconds": 10.0 if seconds is None and program is None else seconds,
        "peer": host_port(trial.controller.peer),
        "timing": shown.timing(trial.controller, gate_s=0.8),
        "answer": shown.path_answer(trial.controller),
        "table": trial.rsi,
        "faults": shown.schedule(trial, fault),
    }
    with progress_bar(f"RSI {rsi.name}") as progress:
        summary = imported(ROBOT_LINKS["rsi"].alone)(Watched(record, print_start, progress), **settings)
    age = summary["age_cycles"]
    print_summary(
        Lines(
            summary,
            "{ended} after {cycles} telegrams, {late_answers} answers late or refused",
            *refused_lines(summary),
            *(
                name.replace("_", " ") + fill(": {mm:g} mm, {deg:g} deg, axes {axes_deg:g} deg", summary[name])
                for name in ("largest_correction", "largest_step")
            ),
            f"correction in force at most {age['max']} cycles old; 4 or less in {age['share_at_most_4']:.4%}",
            *reply_lines(summary),
        ),
        as_json,
    )
    if summary["stalls"] and not as_json:
        typer.echo(f"{summary['stalls']} telegrams sent late: this computer is too slow for real time", err=True)
    require_not_abandoned(summary["ended"])
