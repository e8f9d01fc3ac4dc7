"""Postures and places say what to expect of such cells beside what the model says."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.app.posture import PostureOf
from counterflex.files.cell.cell import read_cell
from counterflex.report.glossary import expected_text

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize("surface", ["both", "wall"])
def test_a_posture_says_median_and_range(surface: str) -> None:
    """The model's own figure lies within; with one surface alone nothing is said that was not counted."""
    cell = read_cell(EXAMPLES / "cells" / "kr300_d16_small.toml")
    found = PostureOf.of(EXAMPLES / "programs" / "groove.ngc", cell, surface=surface)  # type: ignore[arg-type]
    for name in ("present", "chosen"):
        row = found.summary[name]
        if surface == "wall":
            assert row["expected_um"] is None
            assert expected_text(row) == "not counted"
            continue
        median, low, high = row["expected_um"]
        assert low < median < high
        assert low < row["deflection_um"] < high
        assert expected_text(row).startswith(f"{median:.0f} (")
