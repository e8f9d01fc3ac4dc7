"""``preflight --nominal``: a program that makes the part passes; what it gouges or leaves is named by face and line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import step_parts
from counterflex.app import preflight as job
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CELL = EXAMPLES / "cells/kr300_d16_small.toml"
GROOVE = EXAMPLES / "programs/groove.ngc"


def part(tmp_path: Path, y: float = 7.0, z: float = 34.0, blank: tuple[float, float, float] = (60, 60, 40)) -> Path:
    """The part of groove.ngc, its groove from ``y`` to 23 mm and down to ``z``."""
    solid = step_parts.less(step_parts.box((0, 0, 0), blank), step_parts.box((-1, y, z), (61, 23, 41)))
    names = {(y, 0.5 * (z + 40.0)): "right", (23.0, 0.5 * (z + 40.0)): "left", (0.5 * (y + 23.0), z): "floor"}
    key = {(round(a, 3), round(b, 3)): name for (a, b), name in names.items()}
    file = tmp_path / "part.step"

    def named(face: Any) -> str:
        _, across, up = step_parts.centre(face)
        return key.get((round(across, 3), round(up, 3)), "")

    step_parts.write_step(file, [solid], named)
    return file


def rows(nominal: Path, program: Path = GROOVE) -> dict[str, dict[str, Any]]:
    done = job.check(program, read_cell(CELL), nominal=nominal)
    return {row["check"]: row for row in done.summary["checks"] if row["check"].startswith("nominal geometry")}


def test_a_program_makes_its_part(tmp_path: Path) -> None:
    found = rows(part(tmp_path))
    assert list(found) == ["nominal geometry"]
    assert found["nominal geometry"]["verdict"] == "ok"
    assert found["nominal geometry"]["value"] < 0.002
    assert "10 of 10 faces" in found["nominal geometry"]["what"]


def test_a_part_of_which_no_face_is_right_has_no_row_that_is(tmp_path: Path) -> None:
    solid = step_parts.less(
        step_parts.box((0.3, 0.3, 0.3), (59.7, 59.7, 39.7)), step_parts.box((0, 7.3, 33.8), (61, 23.3, 41))
    )
    file = tmp_path / "small.step"
    step_parts.write_step(file, [solid], lambda _: "")
    found = rows(file)
    assert len(found) == 10
    assert {row["verdict"] for row in found.values()} <= {"fail", "warning"}


def test_a_gouge_and_material_left_are_named_by_face_and_line(tmp_path: Path) -> None:
    """The part has its wall 0.3 mm further in than the tool reaches, and its floor 0.2 mm deeper."""
    found = rows(part(tmp_path, y=7.3, z=33.8))
    wall, floor = found["nominal geometry: right"], found["nominal geometry: floor"]
    assert (wall["verdict"], floor["verdict"]) == ("fail", "warning")
    assert wall["value"] == pytest.approx(0.3, abs=1e-3)
    assert floor["value"] == pytest.approx(0.2, abs=1e-3)
    assert "gouged" in wall["what"]
    assert "material left" in floor["what"]
    lines = GROOVE.read_text().splitlines()
    assert {lines[row["line"] - 1] for row in (wall, floor)} == {"G1 X72 F1500"}


def test_a_face_that_no_move_machines_is_whole_material(tmp_path: Path) -> None:
    air = tmp_path / "air.ngc"
    air.write_text(GROOVE.read_text().replace("Y15", "Y45"))
    found = rows(part(tmp_path), air)
    assert found["nominal geometry: floor"]["value"] == pytest.approx(6.0, abs=1e-3)
    assert found["nominal geometry: floor"]["verdict"] == "warning"
    assert any(row["verdict"] == "fail" for name, row in found.items() if "(plane)" in name)  # the top it cuts instead


def test_a_part_elsewhere_or_in_another_form_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not where the blank is"):
        rows(part(tmp_path, blank=(60, 60, 44)))
    mesh = tmp_path / "part.stl"
    mesh.write_text("solid a\nendsolid")
    with pytest.raises(InputError, match=r"\.step"):
        rows(mesh)
    (tmp_path / "part.step").write_text("no step")
    with pytest.raises(FileFormatError, match="not a STEP file"):
        rows(tmp_path / "part.step")


def test_of_several_solids_the_one_in_the_blank_counts(tmp_path: Path) -> None:
    file = part(tmp_path)
    block = step_parts.less(step_parts.box((0, 0, 0), (60, 60, 40)), step_parts.box((-1, 7, 34), (61, 23, 41)))
    step_parts.write_step(file, [step_parts.box((0, 0, -20), (60, 60, 0)), block])
    assert rows(file)["nominal geometry"]["verdict"] == "ok"
    step_parts.write_step(file, [block, step_parts.box((0, 0, 0), (60, 60, 40))])
    with pytest.raises(InputError, match="several solids"):
        rows(file)


def test_a_turning_tool_is_not_looked_at(tmp_path: Path) -> None:
    cell = read_cell(EXAMPLES / "cells/kr300_bc_table.toml")
    done = job.check(EXAMPLES / "programs/tilted_groove.ngc", cell, nominal=part(tmp_path))
    row = next(row for row in done.summary["checks"] if row["check"] == "nominal geometry")
    assert row["verdict"] == "not looked at"


def test_the_command_prints_it(tmp_path: Path, counterflex: Callable[..., Any]) -> None:
    ended = counterflex(
        "preflight", str(GROOVE), "--cell", str(CELL), "--nominal", str(part(tmp_path, y=7.3)), "--json"
    )
    assert ended.status == 1
    checks = {row["check"]: row["verdict"] for row in json.loads(ended.out)["checks"]}
    assert checks["nominal geometry: right"] == "fail"
