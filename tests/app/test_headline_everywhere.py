"""The first figure that a person reads is the median with its range, wherever a plan says what it expects."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

import counterflex as cf
from counterflex.app.campaign.report import _cards
from counterflex.app.compensation.compensate import run
from counterflex.app.compensation.headline import error_rows
from counterflex.app.compensation.next_steps import after_compensation
from counterflex.app.prediction_interval import headline_text
from counterflex.files.cell.cell import read_cell

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
GROOVE = EXAMPLES / "programs" / "groove.ngc"
MEASURED, CLASS = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "cells" / "irb6640_d16.toml"


@pytest.fixture(scope="module", params=[False, True], ids=["catalogue", "class"])
def done(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """Summary and folder of a plan: with the stiffness of the catalogue, and with that of the class."""
    out = tmp_path_factory.mktemp("headline") / "out"
    summary = run(GROOVE, CLASS if request.param else MEASURED, out, assume_class=request.param)
    return summary, out


def test_the_headline_lies_within_its_own_range(done: tuple[dict[str, Any], Path]) -> None:
    headline = done[0]["prediction"]["headline"]
    for key in ("before_mm", "after_mm"):
        median, low, high = headline[key]
        assert low < median < high
    assert 0.0 <= headline["probability_of_worse"] <= 1.0
    assert next(iter(done[0]["prediction"])) == "headline"
    stored = json.loads((done[1] / "summary.json").read_text(encoding="utf-8"))
    assert stored["prediction"]["headline"] == headline


def test_terminal_page_and_campaign_begin_with_it(done: tuple[dict[str, Any], Path]) -> None:
    prediction = done[0]["prediction"]
    headline = prediction["headline"]
    rows = error_rows(prediction)
    assert [row[1] for row in rows[:2]] == [headline_text(headline[key]) for key in ("before_mm", "after_mm")]
    assert all(row[0].startswith("Model without its unknowns") for row in rows[3:])
    page = (done[1] / "report.html").read_text(encoding="utf-8")
    first = re.search(r'<div class="big">(.*?)</div>', page, re.DOTALL)
    assert first is not None
    assert f"{headline['after_mm'][0]:.2f}" in first.group(1)
    assert page.index("Expected path error, median") < page.index("Model without its unknowns")
    cards = _cards({"prediction": prediction, "campaigns": []})
    assert cards[1][1:] == (
        f"{headline['after_mm'][0]:.2f} mm",
        "{:.2f} to {:.2f} mm in nine of ten such cells".format(*headline["after_mm"][1:]),
    )


def test_what_was_accepted_stands_in_the_box(done: tuple[dict[str, Any], Path]) -> None:
    page = (done[1] / "report.html").read_text(encoding="utf-8")
    box = page[page.index('<div class="note">') : page.index("What to load on the controller")]
    accepted = "assumed" in done[0]
    assert ("is assumed from its class, not measured" in box) == accepted


def test_steps_begin_with_what_to_do(done: tuple[dict[str, Any], Path]) -> None:
    summary, _ = done
    cell = read_cell(CLASS if "assumed" in summary else MEASURED, assume_class="assumed" in summary)
    steps = after_compensation(summary, cell, GROOVE)
    verbs = {"Measure", "Try", "Run", "Correct", "Lower", "Cut", "Mend"}
    assert {step.split()[0] for step in steps} <= verbs
    assert steps[0].startswith("Measure the cell: counterflex cell check")


def test_a_notebook_shows_it_first() -> None:
    lines = repr(cf.compensate(GROOVE, MEASURED)).splitlines()
    assert lines[1].startswith("Expected path error before: ")
    assert lines[2].startswith("Expected path error after: ")
