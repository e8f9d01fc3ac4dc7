"""Preflight of whole programs: quiet on clean ones, the same verdict in every language, for every kind of cell."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from counterflex.app import conversion, preflight as job
from counterflex.app.inputs import Reading
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse
from counterflex.plan.preflight.hazards import HAZARDS

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CLEAN = (
    ("groove.ngc", "kr300_d16_flat"), ("corner.ngc", "kr300_d16_small"), ("boss.ngc", "kr300_d16_small"),
    ("cylinder_ball.ngc", "kr300_d10_ball"), ("fc_grooves_pocket.ngc", "kr300_d16_flat"),
    ("fc_profile.ngc", "kr300_d16_flat"), ("fc_ramps.ngc", "kr300_d16_flat"), ("two_tools.ngc", "kr300_d16_small"),
    ("pocket_grooves.ngc", "kr300_d16_small"), ("wall.ngc", "kr300_d16_small"),
    ("tilted_groove.ngc", "kr300_bc_table"), ("groove.ngc", "kr300_held_part"),
)  # fmt: skip
STATED: dict[str, Any] = {
    "controller": {"look_ahead_blocks": 50},
    "limits": {
        "joint_acceleration_deg_s2": [110, 70, 140, 400, 300, 300], "cable_axis4_deg": 270, "cable_axis6_deg": 270,
    },
    "process_limits": {
        "spindle_run_up_s": 0.2, "spindle_min_rpm": 3000, "spindle_max_rpm": 24000,
        "spindle_power_w": 8000, "spindle_torque_nm": 6,
        "force_n": 2000, "axis_torque_nm": [3000, 3000, 3000, 800, 800, 500], "tool_bending_um": 100,
        "deflection_um": 3000, "acceleration_mm_s2": 2000,
    },
}  # fmt: skip
TOOL: dict[str, Any] = {
    "centre_cutting": True, "feed_per_tooth_mm": [0.01, 0.25], "cutting_speed_m_min": [100, 900], "max_rpm": 24000,
    "coolant": False, "holder_mm": [[60, 40], [100, 50]], "overhang_mm": 60,
}  # fmt: skip
HEAD = "G17 G54 G40 G49 G80 G90 G94\nG21\nM6 T1\nG43 H1\nM3 S13000\nG0 Z60\n"
CUT = "G0 X-12 Y15\nG0 Z42\nG1 Z36 F3000\nG1 X72 F1500\n"
END = "G0 Z60\nM5\nM30\n"
FAULTS = {
    "first motion": HEAD.replace("G0 Z60\n", "") + "G0 X20 Y15 Z36\nG1 X72 F1500\n" + END,
    "end of the program": HEAD + CUT.replace("X72", "X20") + "M5\nM30\n",
    "removed material": HEAD + CUT.replace("Y15", "Y115") + END,
    "depth of cut to flutes": HEAD + CUT.replace("Z36", "Z1") + END,
    "spindle torque": HEAD + CUT.replace("Z36", "Z12") + END,
    "feed per tooth": HEAD.replace("S13000", "S3000") + CUT.replace("F1500", "F4500") + END,
    "spindle speed": HEAD.replace("S13000", "S40000") + CUT + END,
}
ENDINGS = {
    "krl": "src",
    "rapid": "mod",
    "fanuc": "ls",
    "val3": "pgx",
    "sinumerik": "mpf",
    "twincat": "nc",
    "apt": "apt",
}


def cell_of(name: str, tool: dict[str, Any] | None = None, **more: Any) -> Cell:
    """A cell of the examples that states all limits of the process."""
    file = EXAMPLES / "cells" / f"{name}.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    for table, values in STATED.items():
        data.setdefault(table, {}).update(values)
    for table in data["tools"]:
        table.update(TOOL | (tool or {}))
    return resolve(parse(CellTables, data | more, where="test"), file)


def rows_of(program: Path, cell: Cell, dialect: str = "ending") -> dict[str, dict[str, Any]]:
    summary = job.check(program, cell, reading=Reading(dialect)).summary
    assert {row["check"] for row in summary["checks"]} == {hazard.check for hazard in HAZARDS}
    return {row["check"]: row for row in summary["checks"]}


@pytest.fixture
def program(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        file = tmp_path / "part.ngc"
        file.write_text(text)
        return file

    return write


def require_quiet(programs: tuple[tuple[str, str], ...]) -> None:
    """No fail, at most two warnings in all."""
    loud: dict[tuple[str, str], str] = {}
    for name, cell in programs:
        rows = rows_of(EXAMPLES / "programs" / name, cell_of(cell))
        loud |= {(name, check): row["verdict"] for check, row in rows.items() if row["verdict"] in ("warning", "fail")}
    assert "fail" not in loud.values(), loud
    assert len(loud) <= 2, loud


@pytest.mark.by_turn
@pytest.mark.parametrize("first", range(3))
def test_clean_programs_are_quiet(first: int) -> None:
    """On cells that state what spindle and tools bear."""
    require_quiet(CLEAN[first::3])


@pytest.mark.long
def test_all_clean_programs_together_are_quiet() -> None:
    require_quiet(CLEAN)


@pytest.mark.long
@pytest.mark.parametrize("language", ENDINGS)
def test_a_fault_has_the_same_verdict_in_every_language(
    language: str, program: Callable[[str], Path], tmp_path: Path
) -> None:
    file, cell = EXAMPLES / "cells" / "kr300_d16_small.toml", cell_of("kr300_d16_small")
    for check, text in FAULTS.items():
        conversion.run(program(text), file, tmp_path / check.replace(" ", "_"), language)
        written = tmp_path / check.replace(" ", "_") / f"part.{ENDINGS[language]}"
        written = written if written.exists() else next(written.parent.glob("part.*"))
        here = rows_of(written, cell, "twincat" if language == "twincat" else "ending")[check]
        expected = rows_of(program(text), cell)[check]
        assert here["verdict"] == expected["verdict"] != "ok"
        assert here["value"] == pytest.approx(expected["value"], rel=0.02, abs=1e-3)


def test_a_part_in_the_hand_is_checked_as_one_on_a_table(program: Callable[[str], Path]) -> None:
    cell = cell_of("kr300_held_part")
    for check in ("first motion", "end of the program", "removed material", "spindle torque", "spindle speed"):
        assert rows_of(program(FAULTS[check]), cell)[check]["verdict"] in ("warning", "fail")
    deep = HEAD + CUT.replace("Z36", "Z22").replace("F1500", "F300") + END
    short = {"holder_mm": [[10, 40], [60, 40]]}
    held = rows_of(program(deep), cell_of("kr300_held_part", short))["tool holder to stock and surroundings"]
    standing = rows_of(program(deep), cell_of("kr300_d16_small", short))["tool holder to stock and surroundings"]
    assert (held["verdict"], standing["verdict"]) == ("fail", "fail")
    assert held["value"] == pytest.approx(-8.0, abs=0.1)  # 18 mm deep, the holder 10 mm above the tip
    assert standing["value"] == pytest.approx(-8.0, abs=0.1)


def test_a_rail_carries_robot_and_bodies(program: Callable[[str], Path]) -> None:
    """The robot has gone along its rail until the part is too near for axis 2; what is cut is the same."""
    rail = {
        "name": "E1",
        "kind": "linear",
        "carries": "robot",
        "direction": [1.0, 0.0, 0.0],
        "min_mm": 0,
        "max_mm": 3000,
    }
    file = program(HEAD + CUT + END)
    plain = rows_of(file, cell_of("kr300_d16_small"))
    home = rows_of(file, cell_of("kr300_d16_small", external_axes=[rail | {"at_mm": 0}]))
    away = rows_of(file, cell_of("kr300_d16_small", external_axes=[rail | {"at_mm": 600}]))
    assert home["reach"]["value"] == plain["reach"]["value"]
    assert (home["joint limits"]["verdict"], away["joint limits"]["verdict"]) == ("ok", "fail")
    assert away["removed material"]["value"] == plain["removed material"]["value"]


@pytest.mark.long
@pytest.mark.parametrize("name", ["tilted_groove.ngc", "twisted_channel.ngc"])
def test_tilted_and_turning_tools_and_their_holders(name: str, tmp_path: Path) -> None:
    """The holder 2 mm above the tip goes into what is left of the blank, one above the blank does not."""
    text = (EXAMPLES / "programs" / name).read_text()
    clear = rows_of(EXAMPLES / "programs" / name, cell_of("kr300_bc_table"))
    assert clear["tool holder to stock and surroundings"]["verdict"] == "ok"
    low = rows_of(EXAMPLES / "programs" / name, cell_of("kr300_bc_table", {"holder_mm": [[2, 30], [80, 30]]}))
    assert low["tool holder to stock and surroundings"]["verdict"] == "fail"
    file = tmp_path / name
    file.write_text(text.replace("S13000", "S40000"))
    assert rows_of(file, cell_of("kr300_bc_table"))["spindle speed"]["verdict"] == "fail"


@pytest.mark.long
def test_a_pocket_that_is_wide_enough_leaves_room_for_the_holder(program: Callable[[str], Path]) -> None:
    """The stock as it is machined so far counts, not the box of the blank; in a slot there is no room."""
    level = "G0 X-12 Y{y}\nG0 Z45\nG1 Z{z} F3000\nG1 X72 F1500\nG0 Z60\n"
    slot = "".join(level.format(y=30, z=z) for z in (34, 28, 22, 16))
    wide = "".join(level.format(y=y, z=z) for z in (34, 28, 22, 16) for y in (8, 20, 30, 40, 52))
    cell = cell_of("kr300_d16_small", {"holder_mm": [[15, 40], [60, 40]]})
    check = "tool holder to stock and surroundings"
    row = rows_of(program(HEAD + slot + END), cell)[check]
    assert row["verdict"] == "fail"
    assert row["value"] == pytest.approx(-9.0, abs=0.1)  # 24 mm deep with 15 mm of reach
    assert rows_of(program(HEAD + wide + slot + END), cell)[check]["verdict"] == "ok"
