"""The runs of a tool and material so far: one numbered folder each below ``runs``, so that new runs join the old."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError, InputError, OutputError
from counterflex.files.production_run_file import read_production_run, write_production_run
from counterflex.identify.production.stretches import Stretches

RUNS: Final = "runs"
STRETCHES, FACTS = "stretches.parquet", "run.json"
_NEEDED: Final = ("run", "sha256", "plan", "tool", "material", "begun_s", "cut_mm", "removed_cm3", "new_tool")


@dataclass(frozen=True, eq=False)
class KeptRun:
    """A run of the history."""

    stretches: Stretches  # Its steady stretches
    facts: dict[str, Any]  # Plain values: run, hashes, tool, material, length cut, delay


def read_history(folder: Path) -> list[KeptRun]:
    """Runs that a folder of results has, in their order; none where it has none.

    Raises FileFormatError: a run is not complete.
    """
    out = []
    for place in sorted((folder / RUNS).glob("[0-9]*")):
        stretches, _ = read_production_run(place / STRETCHES)
        facts = file_content.json_value(place / FACTS)
        lacking = [name for name in _NEEDED if not isinstance(facts, dict) or name not in facts]
        if lacking:
            raise FileFormatError(
                "a run of the history is not complete", where=str(place / FACTS), value=f"without {lacking[0]}"
            )
        out.append(KeptRun(stretches, facts))
    return out


def require_alike(history: list[KeptRun], tool: int, material: str, robot: str, where: Path) -> None:
    """Refuse to go on with a history of another tool, material or robot. Raises InputError: it names both."""
    for kept in history:
        other = kept.facts.get("robot", robot)  # histories of former versions do not state it
        if other != robot:
            raise InputError(
                "the history is of another robot", where=str(where / RUNS), value=other, limit=robot,
                hint="Give each robot an --out of its own",
            )  # fmt: skip
        if (kept.facts["tool"], kept.facts["material"]) != (tool, material):
            raise InputError(
                "the history is of another tool or material",
                where=str(where / RUNS),
                value=f"T{kept.facts['tool']} in {kept.facts['material']}",
                limit=f"T{tool} in {material}",
                hint="Give each tool and material an --out of its own",
            )


def require_unchanged(out: Path, count: int) -> None:
    """Refuse to write behind a history that another process has added to since it was read.

    Raises OutputError: there are more or fewer.
    """
    there = len(list((out / RUNS).glob("[0-9]*")))
    if there != count:
        raise OutputError(
            "another process has written the history meanwhile", where=str(out / RUNS), value=f"{there} runs",
            limit=f"{count} runs, as read", hint="Run the same command again: it goes on from there",
        )  # fmt: skip


def keep_runs(staging: Path, first: int, new: list[KeptRun]) -> None:
    """Write new runs behind those that are there."""
    for number, kept in enumerate(new, first):
        folder = staging / RUNS / f"{number:03d}"
        folder.mkdir(parents=True)
        about = {name: kept.facts[name] for name in ("run", "sha256", "tool", "material")}
        write_production_run(folder / STRETCHES, kept.stretches, about)
        atomic.write_text(folder / FACTS, json.dumps(kept.facts, indent=2) + "\n")
