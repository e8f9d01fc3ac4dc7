"""Results of a campaign as a table: one row for each program, placement, posture, simulated cell and truth level."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import polars

from counterflex.app.campaign.axes import Setup
from counterflex.app.campaign.tasks import Place, machined_name
from counterflex.app.long_jobs.task import Failed
from counterflex.core import atomic
from counterflex.evaluate.truth_level import TruthLevel

FILE: Final = "results.parquet"
LEVELS: Final[tuple[TruthLevel, ...]] = ("identified", "catalogue", "exact")
_FIGURES: Final = ("p997_mm", "max_mm", "rms_mm")
_SCHEMA: Final = {
    "program": polars.String,
    "placement": polars.String,
    "posture": polars.String,
    "branch": polars.String,
    "rotation_about_tool_deg": polars.Float64,
    "seed": polars.Int64,
    "truth_level": polars.String,
    **{f"{variant}_{name}": polars.Float64 for variant in ("nominal", "compensated") for name in _FIGURES},
    "remains_percent": polars.Float64,
    "fault": polars.String,
}


def rows_of_results(
    places: Sequence[Place], setups: Sequence[Setup], results: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    """Rows of the table, in the order of set-ups, seeds, levels.

    Args:
        places: Simulated cells.
        setups: Programs, placements and postures.
        results: Of the tasks, by name.

    Yields:
        Values by column; figures are empty and ``fault`` says why where a task could not be done.
    """
    for setup in setups:
        held = results.get(f"placed/{setup.name}")
        for place in places:
            before = results[machined_name(place, setup, "nominal")]
            for level in LEVELS:
                after = results.get(machined_name(place, setup, level))
                if after is not None:
                    yield _row(place, setup, level, held, (before, after))


def _row(place: Place, setup: Setup, level: str, held: Any, machined: tuple[Any, Any]) -> dict[str, Any]:
    row: dict[str, Any] = dict.fromkeys(_SCHEMA)
    row |= {
        "program": setup.program,
        "placement": setup.placement.name,
        "posture": setup.posture,
        "seed": place.seed,
        "truth_level": level,
        "fault": next((item.why for item in machined if isinstance(item, Failed)), None),
    }
    if isinstance(held, Mapping):
        row |= {key: held[key] for key in ("branch", "rotation_about_tool_deg")}
    for variant, item in zip(("nominal", "compensated"), machined, strict=True):
        if not isinstance(item, Failed):
            row |= {f"{variant}_{name}": item["path"][name] for name in _FIGURES}
    if row["fault"] is None and row["nominal_p997_mm"] > 0.0:
        row["remains_percent"] = 100.0 * row["compensated_p997_mm"] / row["nominal_p997_mm"]
    return row


def write_results(file: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the table as Parquet, whole or not at all."""
    atomic.write_made(file, polars.DataFrame(list(rows), schema=_SCHEMA, orient="row").write_parquet)


def over_seeds(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One entry for each set-up and truth level: median and worst over the simulated cells, and how many failed."""
    groups: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["program"], row["placement"], row["posture"], row["truth_level"]), []).append(row)
    out = []
    for (program, placement, posture, level), members in groups.items():
        entry: dict[str, Any] = {"program": program, "placement": placement, "posture": posture, "truth_level": level}
        for key in ("nominal_p997_mm", "compensated_p997_mm", "remains_percent"):
            values = [row[key] for row in members if row[key] is not None and row["fault"] is None]
            entry[key] = {"median": _round(statistics.median(values)), "worst": _round(max(values))} if values else None
        faults = [row["fault"] for row in members if row["fault"] is not None]
        out.append({**entry, "cells": len(members), "failed": len(faults), "fault": faults[0] if faults else ""})
    return out


def _round(value: float) -> float:
    return round(value, 4)
