"""Command that starts a simulated ABB controller by itself."""

from __future__ import annotations

from typing import Annotated, Any

from counterflex.cli import arguments
from counterflex.cli.arguments import address, option
from counterflex.cli.commands.program import CellFile, Program
from counterflex.cli.commands.question import AsJson
from counterflex.cli.commands.simulated.options import (
    Fault,
    RecordFile,
    print_start,
    refused_lines,
    reply_lines,
    require_not_abandoned,
)
from counterflex.cli.output import Layers, keep_inputs, print_summary, progress_bar
from counterflex.core.result import Lines


def egm(
    program: Program,
    cell: CellFile,
    peer: Annotated[
        str, option("--egm", "Where messages go: address and port of the run.", arguments.host_port, "HOST:PORT")
    ] = "127.0.0.1:6510",
    seconds: Annotated[float | None, option("--seconds", "At most so long.", min=0.01)] = None,
    scenario: Layers = None,
    fault: Fault = None,
    record: RecordFile = None,
    as_json: AsJson = False,
) -> None:
    """Simulate an ABB controller: it sends EGM messages, applies the answers as a real one does, and reports.

    The table [egm] of the cell selects the mode: mode = "path" runs the program with path correction, mode = "pose"
    follows position guidance. No physics, no instruments.

    Tables of the scenario: controller, egm, faults.

    Example: `counterflex twin egm part.ngc --cell cell.toml --egm 127.0.0.1:6510 --record applied.csv`
    """
    keep_inputs(record, program, cell, option="--record")
    from counterflex.files.scenario_file import read_scenario

    trial = read_scenario(scenario or (), ("controller", "egm"))
    import numpy as np

    from counterflex.app.run.robot_links import ROBOT_LINKS
    from counterflex.app.simulated_cell import scenario as shown
    from counterflex.app.simulated_cell.alone import Watched
    from counterflex.core.registry import imported
    from counterflex.core.units import MS

    force, timeout_ms = trial.egm.wrench_n_nm, trial.egm.timeout_ms
    settings: dict[str, Any] = {
        "program": program,
        "cell": cell,
        "peer": address(peer, "--egm"),
        "robotware": trial.egm.robotware,
        "force": None if force is None else np.array(force),
        "timeout_s": None if timeout_ms is None else timeout_ms * MS,
        "dead_s": trial.controller.dead_ms * MS,
        "answer": shown.path_answer(trial.controller),
        "seconds": seconds,
        "timing": shown.timing(trial.controller, gate_s=3.0),
        "faults": shown.schedule(trial, fault),
    }
    with progress_bar(f"EGM {program.name}") as progress:
        summary = imported(ROBOT_LINKS["egm"].alone)(Watched(record, print_start, progress), **settings)
    print_summary(
        Lines(
            summary,
            "{ended} after {cycles} messages, {late_answers} cycles without one for us",
            *refused_lines(summary),
            "largest distance of the tool from its program: {largest_shift_mm:g} mm",
            *reply_lines(summary),
        ),
        as_json,
    )
    require_not_abandoned(summary["ended"])
