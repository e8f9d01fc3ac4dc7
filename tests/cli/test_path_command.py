"""`path` with a cell, and what it leaves empty."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TILTED = EXAMPLES / "cells" / "kr300_bc_table.toml"


def rows(ended: Any) -> list[dict[str, str]]:
    assert ended.status == 0, ended.err
    return list(csv.DictReader(io.StringIO(ended.out)))


def test_machine_places_and_axes_that_nothing_named_are_empty(folder: Path, counterflex: Any) -> None:
    (folder / "home.nc").write_text("G21 G90\nT1 M6\nG0 X0 Y0\nZ45\nG1 Z34 F800\nX72\nG0 Z45\nG53 G0 Z0\nM30\n")
    found = rows(counterflex("path", "home.nc"))
    assert [row["z_mm"] for row in found] == ["", "45.0", "34.0", "34.0", "45.0", ""]
    assert found[-1]["x_mm"] == "72.0"
    refused = counterflex("compensate", "home.nc", "--cell", "cell.toml", "--no-predict", "--out", "o", "--no-report")
    assert refused.status in (0, 2)  # the tool of the cell decides; the way home itself is no fault
    assert "G53" not in refused.err


def test_tools_by_name_and_work_offsets_come_from_the_cell(folder: Path, counterflex: Any) -> None:
    cell = (folder / "cell.toml").read_text()
    name = next(line.split('"')[1] for line in cell[cell.index("[[tools]]") :].splitlines() if line.startswith("name"))
    offsets = "[part]\nwork_offsets_mm = { G54 = [0, 0, 0], G55 = [120, 0, 0] }\n"
    (folder / "two.toml").write_text(cell.replace("[part]\n", offsets, 1))
    text = f'G54 G90\nT="{name}"\nM6\nS1000 M3\nG0 X0 Y0 Z60\nG55\nG0 X1\nM30\n'
    (folder / "two.mpf").write_text(text)
    found = rows(counterflex("path", "two.mpf", "--cell", "two.toml"))
    assert [(row["x_mm"], row["tool"]) for row in found] == [("0.0", "1"), ("121.0", "1")]
    (folder / "other.toml").write_text((folder / "two.toml").read_text().replace(f'"{name}"', f'"{name} 2"'))
    without = counterflex("path", "two.mpf", "--cell", "other.toml")
    assert without.status == 2
    assert "no tool of the cell" in without.err
    (folder / "one.mpf").write_text(text.replace("G55\n", ""))
    assert {row["tool"] for row in rows(counterflex("path", "one.mpf"))} == {"0"}  # no names to compare it with
    (folder / "two.ngc").write_text("G54 G90\nT1 M6\nG0 X0 Y0 Z60\nG55\nG0 X1\nM30\n")
    assert rows(counterflex("path", "two.ngc", "--cell", "two.toml"))[-1]["x_mm"] == "121.0"
    for words in (("--cell", "cell.toml"), ()):
        refused = counterflex("path", "two.ngc", *words)
        assert refused.status == 2
        assert "how far G55 lies from G54 (line 3) along X, Y, Z is not known" in refused.err
        assert "part.work_offsets_mm" in refused.err


@pytest.mark.parametrize("name", ["tilted_groove.ngc", "tilted_groove.mpf"])
def test_the_orientation_of_a_tilted_program_is_printed(name: str, counterflex: Any) -> None:
    found = rows(counterflex("path", str(EXAMPLES / "programs" / name), "--cell", str(TILTED)))
    tilt = math.radians(15.0)
    for row in found[2:]:
        axis = [float(row[key]) for key in ("tool_i", "tool_j", "tool_k")]
        if row["motion"] == "feed":
            assert axis == pytest.approx([-math.sin(tilt), 0.0, math.cos(tilt)], abs=1e-6)
    without = rows(counterflex("path", str(EXAMPLES / "programs" / name)))
    cut = next(row for row in without if row["motion"] == "feed")
    assert (cut["tool_i"] == "") == name.endswith(".ngc")  # rotary words mean nothing without their machine


@pytest.mark.parametrize(("language", "ending"), [("krl", "src"), ("rapid", "mod"), ("fanuc", "ls"), ("val3", "pgx")])
def test_robot_programs_print_how_they_hold_the_tool(
    language: str, ending: str, folder: Path, counterflex: Any
) -> None:
    cell = str(EXAMPLES / "cells" / "kr300_d16_small.toml")
    groove = str(EXAMPLES / "programs" / "groove.ngc")
    made = counterflex("convert", groove, "--to", language, "--cell", cell, "--out", "made")
    assert made.status == 0, made.err
    program = next(file for file in (folder / "made").rglob(f"*.{ending}") if file.stem.lower() == "groove")
    for row in rows(counterflex("path", str(program), "--cell", cell)):
        assert [float(row[key]) for key in ("tool_i", "tool_j", "tool_k")] == pytest.approx([0.0, 0.0, 1.0], abs=1e-4)
        assert row["tool_turn_deg"]
