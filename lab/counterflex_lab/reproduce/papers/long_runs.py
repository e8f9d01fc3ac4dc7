"""Experiments run again: a folder each, and a file of results that can be stored with the program."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from counterflex import __version__
from counterflex.core import atomic
from counterflex.core.next_command import next_command
from counterflex.core.progress import Progress, in_parts
from counterflex_lab.reproduce.papers.experiments import BENCHMARKS, EXPERIMENTS, Options
from counterflex_lab.reproduce.papers.read import stored

RESULT: Final = "result.json"


def run_again(
    names: Sequence[str],
    folder: Path,
    papers: Sequence[str],
    seeds: Sequence[int],
    level: str,
    quick: bool,
    workers: int | None,
    progress: Progress,
) -> dict[str, dict[str, Any]]:
    """Run experiments, or go on with them; those that are benchmarks are taken as stored.

    Args:
        names: Of the experiments.
        folder: A folder of each is made in it, with ``result.json``.
        papers: For which they are run; named in the command that is stored.
        seeds: Truth seeds.
        level: How well the loops know the cell.
        quick: As briefly as possible.
        workers: Runs at a time.
        progress: Progress callback, fraction 0 to 1.

    Returns:
        By name: ``command``, ``cells``, ``version`` and ``results``.
    """
    options = Options(seeds, level, quick, workers)
    word = papers[0] if len(papers) == 1 else "all"
    command = next_command(
        f"reproduce {word}", long=True, seeds=f"{seeds[0]}-{seeds[-1]}", level=level, quick=quick, out="DIR"
    )
    parts = in_parts(progress, {name: 1.0 for name in names if name in EXPERIMENTS} or {"nothing": 1.0})
    out = {}
    for name in names:
        if name in BENCHMARKS:
            if (data := stored(name)) is not None:
                out[name] = data
            continue
        results = EXPERIMENTS[name](folder / name, options, parts[name])
        cells = results.pop("cells", "no simulated cell")
        out[name] = {"command": command, "cells": cells, "version": __version__, "results": results}
        atomic.write_text(folder / name / RESULT, text_of(out[name]))
    return out


def text_of(data: dict[str, Any]) -> str:
    """A result as it is stored: one line for each key of the results."""
    head = {key: value for key, value in data.items() if key != "results"}
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    body = ",\n".join(f"{json.dumps(key)}: {json.dumps(value)}" for key, value in data["results"].items())
    return "{" + ",\n".join([*lines, f'"results": {{\n{body}\n}}']) + "}\n"
