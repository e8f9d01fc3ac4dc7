"""The command ``plan stability``: table, files, JSON, exit status, and one clear error for bad input."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

MODAL = "direction,frequency_hz,damping_ratio,stiffness_n_per_um\nx,900,0.03,{k}\ny,1100,0.03,{k}\n"


@pytest.fixture
def soft(folder: Path) -> str:
    """A spindle that the groove of 3 mm makes chatter."""
    (folder / "soft.csv").write_text(MODAL.format(k=2), encoding="utf-8")
    return "soft.csv"


def test_stable_program(folder: Path, counterflex: Any) -> None:
    (folder / "stiff.csv").write_text(MODAL.format(k=2000), encoding="utf-8")
    ended = counterflex("plan", "stability", "part.ngc", "--cell", "cell.toml", "--modal", "stiff.csv", "--out", "out")
    assert ended.status == 0, ended.err
    assert "stable: least margin" in ended.out
    summary = json.loads((folder / "out" / "summary.json").read_text(encoding="utf-8"))
    with (folder / "out" / "stability.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == summary["stretches"]
    assert min(float(row["margin"]) for row in rows) == summary["worst"]["margin"]
    assert summary["worst"]["axial_depth_mm"] == pytest.approx(3.0, rel=0.05)  # cells of 0.5 mm
    assert (folder / "out" / "lobes.csv").is_file()
    assert "Stability" in (folder / "out" / "report.html").read_text(encoding="utf-8")


def test_soft_spindle_chatters_and_the_line_is_named(folder: Path, counterflex: Any, soft: str) -> None:
    ended = counterflex("plan", "stability", "part.ngc", "--cell", "cell.toml", "--modal", soft, "--json")
    assert ended.status == 1
    summary = json.loads(ended.out)
    assert summary["verdict"] == "chatter"
    assert summary["worst"]["method"] == "spindle and tool"
    text = (folder / "part.ngc").read_text(encoding="utf-8").splitlines()
    assert text[summary["worst"]["line"] - 1] == "G1 X10 F1500"
    assert summary["worst"]["margin"] < 1.0
    assert summary["tools"][0]["semi_discretisation_margin"] == pytest.approx(summary["worst"]["margin"], rel=0.3)


@pytest.mark.long
def test_needed_damping_is_that_of_the_line_where_the_robot_is_softest(
    folder: Path, counterflex: Any, soft: str
) -> None:
    """A soft tool is worst in the full slot, line 12, which needs hardly any; the robot in the wall behind it."""
    program = Path(__file__).resolve().parents[2] / "examples" / "programs" / "corner.ngc"
    cell = program.parents[1] / "cells" / "kr300_d16_small.toml"
    summary = json.loads(
        counterflex("plan", "stability", str(program), "--cell", str(cell), "--modal", soft, "--json").out
    )
    assert summary["worst"]["method"] == "spindle and tool"
    assert summary["worst"]["line"] <= 13
    assert summary["tools"][0]["needed_damping_ratio"] == pytest.approx(0.055, abs=0.01)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--modal", "soft.csv", "--response", "soft.csv"), "tool tip is given twice"),
        (("--response", "soft.csv"), "no column real_um_per_n"),
        (("--modal", "none.csv"), "no such file"),
        (("--damping", "3"), "out of range"),
        (("--out", "."), "could be replaced"),
    ],
)
def test_bad_input(folder: Path, counterflex: Any, soft: str, words: tuple[str, ...], says: str) -> None:
    before = sorted(item.name for item in folder.iterdir())
    ended = counterflex("plan", "stability", "part.ngc", "--cell", "cell.toml", *words)
    assert ended.status == 2
    assert says in ended.err
    assert len(ended.err.strip().splitlines()) == 1
    assert sorted(item.name for item in folder.iterdir()) == before


def test_program_that_cuts_nothing(folder: Path, counterflex: Any) -> None:
    (folder / "air.ngc").write_text("G21 G90\nM6 T1\nM3 S9000\nG0 Z60 X0 Y0\nG1 X20 F500\nM2\n", encoding="utf-8")
    ended = counterflex("plan", "stability", "air.ngc", "--cell", "cell.toml", "--out", "out")
    assert ended.status == 2
    assert "cuts nothing" in ended.err
    assert not (folder / "out").exists()
