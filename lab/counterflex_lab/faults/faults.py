"""Inject every fault and judge what came of it: a table that says so."""

from __future__ import annotations

import csv
import io
import os
import platform
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.app.environment import environment
from counterflex.core import atomic
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress, silent
from counterflex.files.summary_file import write_summary
from counterflex_lab.faults import SCENARIOS
from counterflex_lab.faults.scenario import SENSORS, Effort, Outcome, Scenario

TABLE: Final = "faults.csv"
PAGE: Final = "faults.md"
SUMMARY: Final = "summary.json"
_SENSOR_TEXTS: Final = {"force": "a force sensor", "both": "a force sensor and a tracker at once"}


@dataclass(frozen=True)
class Result:
    """One fault and what came of it."""

    scenario: Scenario  # what was injected
    outcome: Outcome  # what came of it
    seconds: float  # how long it took


def chosen(only: tuple[str, ...], *, realtime: bool = True, sensors: str = "force") -> tuple[Scenario, ...]:
    """Scenarios of some requirements or names.

    Args:
        only: Numbers of requirements (``R3``) or names of scenarios; empty: all.
        realtime: Those that take real time, too.
        sensors: What the loop corrects from, one of :data:`SENSORS`: those that can be run with it.

    Raises:
        InputError: One of them does not exist, or no such sensors.
    """
    if sensors not in SENSORS:
        raise InputError("no such sensors", where="--sensors", value=sensors, limit=" or ".join(SENSORS))
    requirements, names = ({getattr(s, key) for s in SCENARIOS} for key in ("requirement", "name"))
    requested = {word.upper() if word.upper() in requirements else word for word in only} or requirements
    unknown = next((word for word in only if not {word, word.upper()} & (requirements | names)), None)
    if unknown is not None:
        limit = ", ".join(sorted(requirements, key=lambda r: int(r[1:])))
        raise InputError("no fault is injected for this", where="--only", value=unknown, limit=limit)
    return tuple(
        s
        for s in SCENARIOS
        if {s.requirement, s.name} & requested and (realtime or not s.realtime) and sensors in s.sensors
    )


def run(
    out: str | Path,
    *,
    only: tuple[str, ...] = (),
    quick: bool = False,
    realtime: bool = True,
    seed: int = 0,
    sensors: str = "force",
    progress: Progress = silent,
) -> list[Result]:
    """Inject faults, one after the other, and write table, page and summary.

    Args:
        out: Folder.
        only: See :func:`chosen`.
        quick: Small samples.
        realtime: Those that take real time, too.
        seed: Of everything that is random.
        sensors: See :func:`chosen`.
        progress: Progress callback, fraction 0 to 1.

    Raises:
        InputError: Nothing of that name, or nothing that can be run with these sensors.
        OutputError: The folder cannot be written.
    """
    scenarios = chosen(only, realtime=realtime, sensors=sensors)
    if not scenarios:
        raise InputError(
            "nothing of this can be run so",
            where="--only",
            value=", ".join(only),
            hint="Leave out --sensors or --no-realtime",
        )
    effort = Effort(quick, seed, sensors)
    condition = machine()
    results = []
    for k, scenario in enumerate(scenarios):
        progress(k / len(scenarios), f"{scenario.requirement} {scenario.name}")
        begin = time.perf_counter()
        try:
            outcome = scenario.run(effort)
        except CounterflexError as fault:
            outcome = Outcome(False, f"did not run: {fault}")
        results.append(Result(scenario, outcome, time.perf_counter() - begin))
    with atomic.atomic_folder(out) as staging:
        atomic.write_text(staging / TABLE, table(results))
        atomic.write_text(staging / PAGE, page(results, condition, effort))
        write_summary(staging / SUMMARY, summary(results, condition, effort))
    return results


def machine() -> dict[str, Any]:
    """The machine and how busy it is."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    return {**environment(), "kernel": platform.release(), "cores": os.cpu_count() or 0, "load": round(load, 2)}


def table(results: list[Result]) -> str:
    """CSV: a row per fault; steps in mm, times in s."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(
        ["requirement", "name", "passed", "injected", "required", "happened", "largest_step_mm", "safe_s", "seconds"]
    )
    for result in results:
        s, o = result.scenario, result.outcome
        writer.writerow(
            [
                s.requirement,
                s.name,
                o.passed,
                s.injected,
                s.required,
                o.happened,
                _step(o),
                _safe(o),
                f"{result.seconds:.1f}",
            ]
        )
    return stream.getvalue()


def page(results: list[Result], condition: dict[str, Any], effort: Effort) -> str:
    """Markdown table of the results."""
    passed = sum(result.outcome.passed for result in results)
    lines = [
        f"{passed} of {len(results)} hold, corrected from {_SENSOR_TEXTS[effort.sensors]}. "
        f"{condition['processor']}, {condition['cores']} cores, kernel "
        f"{condition['kernel']}, load {condition['load']:g} at the start, counterflex {__version__}.",
        "",
        "| | injected | required | happened | largest step mm | safe after s | |",
        "|---|---|---|---|---|---|---|",
    ]
    for result in results:
        s, o = result.scenario, result.outcome
        cells = (
            f"{s.requirement} {s.name}",
            s.injected,
            s.required,
            o.happened,
            _step(o),
            _safe(o),
            "holds" if o.passed else "**does not hold**",
        )
        lines.append("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def summary(results: list[Result], condition: dict[str, Any], effort: Effort) -> dict[str, Any]:
    """All of it, for programs."""
    return {
        "job": "faults",
        "counterflex": __version__,
        "machine": condition,
        "quick": effort.quick,
        "seed": effort.seed,
        "sensors": effort.sensors,
        "passed": all(result.outcome.passed for result in results),
        "faults": {
            f"{r.scenario.requirement} {r.scenario.name}": {
                "passed": r.outcome.passed,
                "injected": r.scenario.injected,
                "required": r.scenario.required,
                "happened": r.outcome.happened,
                "largest_step_mm": None if r.outcome.step_m is None else round(r.outcome.step_m * 1e3, 4),
                "safe_s": None if r.outcome.safe_s is None else round(r.outcome.safe_s, 4),
                "realtime": r.scenario.realtime,
                "seconds": round(r.seconds, 2),
                **r.outcome.figures,
            }
            for r in results
        },
    }


def _step(outcome: Outcome) -> str:
    return "" if outcome.step_m is None else f"{outcome.step_m * 1e3:.3f}"


def _safe(outcome: Outcome) -> str:
    return "" if outcome.safe_s is None else f"{outcome.safe_s:.3f}"
