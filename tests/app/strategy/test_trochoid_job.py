"""`plan trochoid`: the loops cut the same slot with the engagement that was asked for and less force; bad input."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.inputs import read_job
from counterflex.app.proof.simulate import undisturbed
from counterflex.app.strategy.trochoid import Trochoid, rewrite, run
from counterflex.core.errors import CounterflexError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import read_cell
from counterflex.files.schema import write_toml

CELL = Path(__file__).parents[2] / "data" / "cells" / "small.toml"
HEAD = "G21 G17 G90 G94\nM6 T1\nG43 H1\nM3 S13000\nG0 Z60\nG0 X-10 Y15\nG0 Z42\nG1 Z36 F3000\n"
SLOT = "G1 X50 F1500\n"
END = "G0 Z60\nM30\n"


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    data = tomllib.loads(CELL.read_text(encoding="utf-8"))
    data["tools"].append({"number": 2, "diameter_mm": 10, "flutes": 3, "flute_length_mm": 25})
    write_toml(tmp_path / "cell.toml", data)
    return tmp_path / "cell.toml"


def program(folder: Path, text: str) -> Path:
    (folder / "slot.ngc").write_text(text, encoding="utf-8")
    return folder / "slot.ngc"


@pytest.mark.parametrize("up", [True, False])
def test_the_loops_cut_the_same_slot_gently(up: bool, cell: Path, tmp_path: Path) -> None:
    source = program(tmp_path, HEAD + SLOT + END)
    summary = run(source, cell, tmp_path / "out", Trochoid(tool=2, engagement_rad=45 * DEG, up=up))
    assert summary["engagement_deg"] == pytest.approx(45.0, abs=0.01)
    assert 38.0 <= summary["cut_engagement_deg"] <= 49.0  # the grid blurs ends of arcs by some degrees
    assert summary["volume_percent"] == pytest.approx(100.0, abs=0.1)
    assert summary["peak_force_n"][1] < 0.5 * summary["peak_force_n"][0]
    known = read_cell(cell)
    slot, loops = (undisturbed(read_job(path, known), known) for path in (source, tmp_path / "out" / "slot.ngc"))
    assert np.mean(np.abs(slot.z - loops.z) > 0.01 * MM) < 2e-3  # cells on the walls
    text = (tmp_path / "out" / "slot.ngc").read_text(encoding="utf-8")
    assert "M6 T2\nG43 H2" in text
    assert ("G2 " in text) == up
    assert text.endswith(END)
    assert re.search(r"G1 X50.0000 Y15.0000 F1500.000\nG0 Z60", text)


def test_a_wider_slot_keeps_its_tool(cell: Path, tmp_path: Path) -> None:
    source = program(tmp_path, HEAD + SLOT + END)
    known = read_cell(cell)
    result, _ = rewrite(read_job(source, known), known, Trochoid(width_m=20 * MM, engagement_rad=40 * DEG))
    assert result.tool == 1
    assert result.loop.radius_m == pytest.approx(2 * MM)


def test_loops_are_slowed_where_the_controller_cannot_turn_as_fast(cell: Path, tmp_path: Path) -> None:
    source = program(tmp_path, HEAD + SLOT.replace("1500", "9000") + END)
    known = read_cell(cell)
    asked = Trochoid(tool=2, engagement_rad=40 * DEG)
    result, _ = rewrite(read_job(source, known), known, asked)
    assert result.bound == "acceleration"
    limit = known.tables.controller.acceleration_m_s2
    assert result.feed_m_s**2 / result.loop.radius_m == pytest.approx(limit)


@pytest.mark.parametrize(
    ("text", "changes", "said"),
    [
        (HEAD.replace("Y15", "Y36") + SLOT + END, {"tool": 2}, "mills no straight slot"),
        (HEAD.replace("X-10", "X20") + SLOT + END, {"tool": 2}, "slot.ngc:9.*begins in the material.*Open it first"),
        (HEAD + SLOT + END, {}, "too wide for loops"),
        (HEAD + SLOT + END, {"tool": 5}, "does not have"),
        (HEAD + "G91\nG1 X60 F1500\nG90\n" + END, {"tool": 2}, "slot.ngc:10.*G90"),
        (HEAD + "G1 X50 F1500 M8\n" + END, {"tool": 2}, "slot.ngc:9.*cannot be replaced"),
        (HEAD + SLOT + "G1 Y40\n" + END, {"tool": 2}, "does more than slots|mills"),
    ],
)
def test_bad_input_is_said(text: str, changes: dict[str, Any], said: str, cell: Path, tmp_path: Path) -> None:
    source = program(tmp_path, text)
    with pytest.raises(CounterflexError, match=said):
        run(source, cell, tmp_path / "out", Trochoid(**changes))
    assert not (tmp_path / "out").exists()
