"""Command thermal: growth of spindle and arm from touches between cuts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from counterflex.cli import arguments
from counterflex.cli.arguments import argument, numbers, option
from counterflex.cli.output import keep_inputs, print_summary


def thermal(
    touches: Annotated[
        Path,
        argument(
            "CSV: time_s,x_mm,y_mm,z_mm; where known spindle_rpm,sigma_um,temperature_c.", arguments.file, "TOUCHES"
        ),
    ],
    axis: Annotated[
        str, option("--axis", "Direction from spindle to tip, part axes.", arguments.numbers_of(3), "X,Y,Z")
    ] = "0,0,-1",
    limit_um: Annotated[
        float, option("--limit-um", "Growth and drift that are tolerated.", min=1.0, max=10_000.0)
    ] = 30.0,
    um_per_k: Annotated[
        float | None,
        option("--um-per-k", "Growth per kelvin of temperature_c; without it that is not used.", min=0.01, max=100.0),
    ] = None,
    model: Annotated[
        Path | None, option("--model", "What an earlier call learnt of this machine.", arguments.file, "FILE")
    ] = None,
    out: Annotated[
        Path | None, option("--out", "File for what was learnt of this machine (.json).", arguments.output_file, "FILE")
    ] = None,
    as_json: Annotated[bool, option("--json", "Print JSON instead of the table.")] = False,
) -> None:
    """Follow the thermal growth of spindle and arm through touches of one place between cuts.

    The spindle warms up towards a growth that rises with its speed, the arm drifts. Both are stated with their standard
    deviation. Exit status 1 with an alert: growth or drift beyond the limit, a place that jumped between two touches,
    or touches that were not foretold. Such an alert stays until a new file begins.

    Example: `counterflex thermal touches.csv --limit-um 100 --out growth.json`
    """
    from counterflex.app import thermal as job
    from counterflex.core.units import UM

    keep_inputs(out, touches, model)
    x, y, z = numbers(axis, "--axis", 3) or (0.0, 0.0, -1.0)
    per_kelvin_m = None if um_per_k is None else um_per_k * UM
    summary = job.ThermalSettings(touches, (x, y, z), limit_um * UM, per_kelvin_m, model).run(out)
    print_summary(summary, as_json, out)
    if summary["alerts"]:
        raise typer.Exit(1)
