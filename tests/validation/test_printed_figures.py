"""Figures of the papers beside ours: verdicts follow from the numbers, and ours are what formulas of their own give."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.validation.reproduce.printed import haehn2020, mandiola2023, table
from counterflex.validation.reproduce.printed.row import PAPERS, Printed

ROW = Printed("berger2013", "eq. 1", "x", "mm", "2", 2.0, 1.9, 2.1, "rounding", "a reason")


@pytest.mark.parametrize(
    ("ours", "verdict", "reason"),
    [
        (1.9, "reproduced", "rounding"),
        (2.1, "reproduced", "rounding"),
        (2.11, "differs", "a reason"),
        (None, "cannot be checked", "a reason"),
    ],
)
def test_the_verdict_follows_from_the_numbers(ours: float | None, verdict: str, reason: str) -> None:
    row = replace(ROW, value=ours)
    assert (row.verdict, row.reason) == (verdict, reason)


def test_every_figure_has_a_verdict_and_a_reason(tmp_path: Path) -> None:
    summary = table.run(PAPERS, tmp_path / "out")
    rows = summary["figures"]
    assert len(rows) >= 25
    assert {row["paper"] for row in rows} == set(PAPERS)
    assert sum(summary["counts"].values()) == len(rows)
    for row in rows:
        assert row["reason"], row["what"]
        assert (row["ours"] is None) == (row["verdict"] == "cannot be checked")
    text = (tmp_path / "out" / "figures.md").read_text()
    assert text.count("| reproduced |") == summary["counts"]["reproduced"]
    assert (tmp_path / "out" / "report.html").stat().st_size > 1000


def test_formulas_in_closed_form() -> None:
    rows = {row["what"]: row["ours"] for row in table.run(("berger2013", "mandiola2023"), None)["figures"]}
    assert rows["f_z for h_m, slot: how much too large"] == pytest.approx(math.pi / 2.0, rel=1e-3)
    phi = math.acos(0.9)
    assert rows["the same at a twentieth of the diameter"] == pytest.approx(phi / (1.0 - 0.9), rel=1e-3)
    assert rows["least distance of points, EN AW-7075, 45 ms"] == pytest.approx(2040.0 * 45.0 / 60.0 / 1000.0, rel=1e-3)


def test_fourteen_of_fifteen_terms_are_independent_however_many_orientations() -> None:
    """Removing the redundant square leaves full rank: nothing else repeats."""
    assert haehn2020.independent_terms(27) == haehn2020.independent_terms(500) == 14
    q = np.random.default_rng(3).normal(size=(100, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    assert np.ptp((q**2).sum(axis=1)) < 1e-12


def test_figures_of_experiments_are_taken_from_their_summaries() -> None:
    variants = {name: {"path": {"median_max_mm": v}} for name, v in (("uncompensated", 1.5), ("force_pilot", 0.3))}
    rows = {row.what: row for row in haehn2020.rows({"variants": variants})}
    assert rows["largest deviation, uncompensated"].verdict == "reproduced"
    assert rows["taken away by pilot control"].value == pytest.approx(80.0)
    assert rows["largest deviation, force alone"].verdict == "cannot be checked"
    assert all(row.verdict == "cannot be checked" for row in mandiola2023.rows() if row.place.startswith("figure"))
