"""Headlines of 60 plans: each within its own range, the page shows what is stored, levels know what they say."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from counterflex.app.compensation.prediction import figures
from counterflex.app.inputs import read_job, setting_of
from counterflex.app.prediction_interval import with_intervals
from counterflex.app.proof.truth import truth_of
from counterflex.files.cell.cell import read_cell
from counterflex.plan.compensate import plan as make_plan
from counterflex.twin.truth.family import FAMILIES, REPORTING_SEEDS

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    sys.path.insert(0, str(ROOT / "benchmarks"))
    spec = importlib.util.spec_from_file_location("headline", ROOT / "benchmarks" / "headline.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_headline_lies_within_its_range(bench: ModuleType) -> None:
    rows = json.loads(bench.STORED.read_text(encoding="utf-8"))["rows"]
    assert len(rows) == 60
    assert [(row["level"], row["program"], row["seed"]) for row in rows] == list(bench.plans(list(bench.LEVELS), False))
    assert all(all(bench.within(row, "headline")) for row in rows)
    assert {row["seed"] for row in rows} <= set(REPORTING_SEEDS)


def test_the_page_shows_what_is_stored(bench: ModuleType) -> None:
    rows = json.loads(bench.STORED.read_text(encoding="utf-8"))["rows"]
    text = bench.PAGE.read_text(encoding="utf-8")
    assert bench.with_block(text, rows) == text


def test_a_figure_outside_its_range_is_counted(bench: ModuleType) -> None:
    row = {
        "level": "exact", "before_mm": [1.0, 0.8, 1.3], "after_mm": [0.2, 0.1, 0.3], "model_mm": [1.0, 0.05],
        "cell_mm": [1.4, 0.2], "probability_of_worse": 0.25,
    }  # fmt: skip
    assert bench.within(row, "headline") == [True, True]
    assert bench.within(row, "model_mm") == [True, False]
    assert bench.within(row, "cell_mm") == [False, True]
    assert "| exact | 1 | 2 of 2 | 1 of 2 | 1 of 2 | 25.0 % | 0 of 1 | not kept |" in bench.table([row])
    assert "| 25.0 % | 0 of 1 | 12ab |" in "".join(bench.table([row | {"commit": "12ab"}]))


def test_levels_that_were_not_run_stay(bench: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored = tmp_path / "headline.json"
    monkeypatch.setattr(bench, "STORED", stored)
    old, new = ({"level": level, "commit": "old"} for level in ("exact", "class")), {"level": "class", "commit": "new"}
    assert bench.with_stored([new]) == [new]
    stored.write_text(json.dumps({"rows": list(old)}))
    assert bench.with_stored([new]) == [new, {"level": "exact", "commit": "old"}]


def test_who_knows_the_truth_expects_less_and_more_narrowly(bench: ModuleType) -> None:
    """One plan, judged as of the catalogue and as of a cell that is known exactly."""
    cell = read_cell(ROOT / "examples" / "cells" / "kr300_d16_small.toml")
    truth = truth_of(cell, 1, FAMILIES["wide"])
    job = read_job(ROOT / "examples" / "programs" / "groove.ngc", cell)
    plan = make_plan(job.path, job.line_of_motion, cell.stock(), setting_of(cell), feeds=job.feeds)
    ends = [
        np.array(with_intervals(figures(plan), plan, known)["headline"]["after_mm"])
        for known in (cell, bench.known_exactly(cell, truth))
    ]
    assert ends[1][0] < 0.7 * ends[0][0]
    assert ends[1][2] - ends[1][1] < 0.5 * (ends[0][2] - ends[0][1])
