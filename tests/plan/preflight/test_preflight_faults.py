"""Planted faults: each stops a program that is otherwise clean, or is named as not looked at.

The cell states everything that a preflight can read. The clean program of each kind has no warning; one change plants
the fault.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from counterflex.app import preflight as job
from counterflex.core.errors import ProgramError
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse
from counterflex.plan.preflight.hazards import HAZARDS

SMALL = Path(__file__).resolve().parents[2] / "data" / "cells" / "small.toml"
EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "programs"
STATED: dict[str, Any] = {
    "controller": {"look_ahead_blocks": 50, "blending_mm": 0.5, "acceleration_mm_s2": 1000, "rapid_mm_s": 250},
    "limits": {
        "joint_acceleration_deg_s2": [110, 70, 140, 400, 300, 300], "cable_axis4_deg": 270, "cable_axis6_deg": 270,
        "corner_error_um": 400,
    },
    "process_limits": {
        "spindle_run_up_s": 0.2, "spindle_min_rpm": 3000, "spindle_max_rpm": 24000,
        "spindle_power_w": 8000, "spindle_torque_nm": 6,
        "force_n": 2000, "axis_torque_nm": [3000, 3000, 3000, 800, 800, 500], "tool_bending_um": 100,
        "deflection_um": 2500, "acceleration_mm_s2": 2000,
    },
    "robot": {"play": [{"axis": axis, "dead_band_half_urad": 4.0} for axis in range(1, 7)]},
    "monitor": {"force_limit_n": 2000},
}  # fmt: skip
T1: dict[str, Any] = {
    "number": 1, "diameter_mm": 16, "flutes": 3, "flute_length_mm": 35, "overhang_mm": 60, "centre_cutting": False,
    "ramp_deg": 5, "feed_per_tooth_mm": [0.015, 0.2], "cutting_speed_m_min": [150, 900], "max_rpm": 20000,
    "coolant": False, "holder_mm": [[60, 40], [100, 50]],
}  # fmt: skip
T2 = T1 | {"number": 2, "diameter_mm": 10, "centre_cutting": True, "overhang_mm": 45, "flute_length_mm": 25,
           "max_rpm": 30000, "holder_mm": [[45, 30], [100, 50]]}  # fmt: skip
COMMENTS = "(T1 D=16. CR=0. - flat end mill)\n(T2 D=10. CR=0. - flat end mill)\n"
HEAD = COMMENTS + "G17 G54 G40 G49 G80 G90 G94\nG21\nM6 T1\nG43 H1\nM3 S13000\nG0 Z60\n"
CUT = "G0 X-12 Y15\nG0 Z42\nG1 Z36 F3000\nG1 X52 F1500\n"
END = "G0 Z60\nM5\nM30\n"
CLEAN = HEAD + CUT + END


@dataclass(frozen=True)
class Fault:
    """A fault in a program or against the cell, and the row that must name it."""

    check: str
    program: str
    verdicts: tuple[str, ...] = ("fail",)
    cell: dict[str, dict[str, Any]] = field(default_factory=dict)
    tool: dict[str, Any] = field(default_factory=dict)


def changed(old: str, new: str, program: str = CLEAN) -> str:
    """A program with one piece of text replaced."""
    assert old in program, old
    return program.replace(old, new, 1)


def levels(*heights: float) -> str:
    """A slot in several levels."""
    return "G0 X-12 Y15\n" + "".join(f"G0 Z45\nG1 Z{z} F3000\nG1 X52 F1500\nG0 Z60\nG0 X-12\n" for z in heights)


WARNS, STOPS, NAMED = ("warning",), ("warning", "fail"), ("not looked at",)
FAULTS = {
    # of the kinds of the list
    "first motion ends in the blank": Fault(
        "first motion", changed("G0 Z60\nG0 X-12 Y15\nG0 Z42\n", "G0 X20 Y15 Z36\n")
    ),
    "first motion beside the blank below its top": Fault(
        "first motion", changed("G0 Z60\nG0 X-12 Y15\n", "G0 X-12 Y15 Z30\n"), WARNS
    ),
    "first motion at no height": Fault("first motion", changed("G0 Z60\nG0 X-12", "G0 X-12"), NAMED),
    "rapid through the blank": Fault("rapids into the stock", changed("G1 X52 F1500", "G0 X52")),
    "rapid plunge": Fault("rapids into the stock", changed(CUT, "G0 X20 Y15\nG0 Z36\nG1 X52 F1500\n")),
    "torque": Fault("spindle torque", changed("G1 Z36", "G1 Z10")),
    "power": Fault("spindle power", changed("Z36 F3000\nG1 X52 F1500", "Z12 F3000\nG1 X52 F6000")),
    "speed above the spindle": Fault("spindle speed", changed("S13000", "S40000")),
    "speed below the spindle": Fault("spindle speed", changed("S13000", "S2000"), WARNS),
    "speed above the tool": Fault("spindle speed", changed("S13000", "S22000")),
    "speed at which a broken tooth is hidden": Fault(
        "broken tooth in the force signal", changed("S13000", "S15000"), NAMED
    ),
    "speed at which some slips hide it": Fault("broken tooth in the force signal", changed("S13000", "S14900"), WARNS),
    "feed per tooth too large": Fault("feed per tooth", changed("S13000", "S3500", changed("F1500", "F3000"))),
    "feed per tooth rubs": Fault("feed per tooth", changed("F1500", "F200"), WARNS),
    "H of another tool": Fault("tool length offset", changed("H1", "H2"), WARNS),
    "no H": Fault("tool length offset", changed("G43 H1\n", ""), WARNS),
    "H cancelled before the cut": Fault("tool length offset", changed("G0 Z42", "G49 G0 Z42"), WARNS),
    "beside the blank": Fault("removed material", changed("Y15", "Y115"), WARNS),
    "above the blank": Fault("removed material", changed("Z36", "Z41"), WARNS),
    "plunge with a mill that does not cut at its centre": Fault(
        "plunging", changed(CUT, "G0 X20 Y15\nG0 Z42\nG1 Z38 F200\nG1 X52 F1500\n")
    ),
    "ramp that is too steep": Fault(
        "plunging", changed(CUT, "G0 X5 Y15\nG0 Z41\nG1 Z40 F1000\nG1 X15 Z36 F800\nG1 X52 F1500\n")
    ),
    "plunge with an unknown mill": Fault(
        "plunging", changed(CUT, "G0 X20 Y15\nG0 Z42\nG1 Z38 F200\nG1 X52 F1500\n"), NAMED,
        tool={"centre_cutting": None, "ramp_deg": None},
    ),
    "ends in the cut": Fault("end of the program", changed("G1 X52 F1500\nG0 Z60\n", "G1 X20 F1500\n")),
    "no retract": Fault(
        "end of the program", changed("G1 X52 F1500\nG0 Z60\n", "G1 X52 F1500\nG1 X20\n"), WARNS
    ),
    "spindle off in the cut": Fault("spindle in the cut", changed("M3 S13000", "S13000")),
    "spindle stopped before the retract": Fault("spindle in the cut", changed("X52 F1500\n", "X20 F1500\nM5\n")),
    "spindle backwards": Fault("spindle in the cut", changed("M3", "M4")),
    "work offset that nobody defined": Fault("work offset", changed("G54", "G55"), NAMED),
    "second work offset": Fault("work offset", changed(END, "G0 Z60\nG55\n" + CUT + END), NAMED),
    "diagonal from an unknown place": Fault(
        "first motion", changed("G0 X-12 Y15\nG0 Z42\nG1 Z36 F3000", "G0 X-12 Y15 Z36"), WARNS
    ),
    "down at an unknown place, then up": Fault(
        "first motion", changed("G0 Z60\nG0 X-12 Y15\n", "G0 Z30\nG0 X-12 Y15 Z60\n"), WARNS
    ),
    "program for another diameter": Fault("tool of the program", changed("D=16.", "D=20."), WARNS),
    "program that names no diameter": Fault(
        "tool of the program", changed("(T1 D=16. CR=0. - flat end mill)\n", ""), NAMED
    ),
    "block that a switch skips": Fault("words with two readings", changed("G1 Z36", "/G1 Z30 F3000\nG1 Z36"), NAMED),
    "stop for a person in the cut": Fault(
        "standing in the cut", changed("G1 X52 F1500", "G1 X20 F1500\nM0\nG1 X52"), WARNS
    ),
    "feed per turn": Fault("correction", changed("G1 X52 F1500", "G95 G1 X52 F1500")),
    "rapid just above a clamp": Fault(
        "tool to surroundings", changed("G0 X-12 Y15\nG0 Z42\n", "G0 X-60 Y15\nG0 X-12\nG0 Z42\n"), WARNS,
        cell={"cell": {"body": [{"name": "clamp", "frame": "part", "shape": "box", "size_mm": [10, 10, 80],
                                 "x_mm": -30, "y_mm": 15, "z_mm": 19.6}]}},
    ),
    # of our own kinds
    "cut deeper than the flutes": Fault("depth of cut to flutes", changed("G1 Z36", "G1 Z3"), tool={"overhang_mm": 80}),
    "holder into the wall": Fault(
        "tool holder to stock and surroundings", changed(CUT, levels(35, 30, 25)),
        tool={"holder_mm": [[12, 40], [60, 40]]},
    ),
    "spindle near the part": Fault(
        "robot and spindle to surroundings", changed(CUT, levels(35, 30, 25, 20)), STOPS, tool={"overhang_mm": 35}
    ),
    "tool into the table": Fault("tool to surroundings", changed("G1 Z36 F3000", "G1 Z-5 F3000")),
    "tool change in the part": Fault(
        "tool change", changed("G1 X52 F1500\n", "G1 X20 F1500\nM6 T2\nG43 H2\nM3 S13000\nG1 X52 F1200\n")
    ),
    "second tool in the air": Fault(
        "removed material",
        changed(END, "G0 Z60\nM6 T2\nG43 H2\nM3 S16000\nG0 X-12\nG1 Z36 F1200\nG1 X52\n" + END), WARNS,
    ),
    "H of the first tool kept": Fault(
        "tool length offset",
        changed(END, "G0 Z60\nM6 T2\nM3 S16000\nG0 X-12\nG1 Z34 F1200\nG1 X52\n" + END), WARNS,
    ),
    "cutting speed of another material": Fault("cutting speed", changed("S13000", "S19000"), WARNS),
    "coolant on a tool that must stay dry": Fault("coolant", changed("M3", "M8\nM3"), WARNS),
    "too fast on a small arc": Fault(
        "acceleration on arcs", changed("G1 X52 F1500\n", "G1 X20 F1500\nG2 X20 Y15 I1 J0 F6000\nG1 X52 F1500\n"), WARNS
    ),
    "tool that bends": Fault("tool bending", changed("G1 Z36", "G1 Z28"), WARNS, tool={"overhang_mm": 140}),
    "axis torque": Fault(
        "torque of the axes", CLEAN, cell={"process_limits": {"axis_torque_nm": [100, 100, 100, 20, 20, 20]}}
    ),
    "deflection": Fault("deflection", CLEAN, WARNS, cell={"process_limits": {"deflection_um": 300}}),
    "out of reach": Fault("reach", changed("G0 X-12", "G0 X2500\nG0 X-12")),
    "cable wound up": Fault("cable wind-up, axis 6", CLEAN, cell={"limits": {"cable_axis6_deg": 90}}),
    "play in a corner": Fault(
        "reversals in the cut", changed("G1 X52 F1500\n", "G1 X25 F1500\nG1 Y19\nG1 X5\n"), WARNS,
        cell={"robot": {"play": [{"axis": axis, "dead_band_half_urad": 100.0} for axis in range(1, 7)]}},
    ),
    "dwell in the cut": Fault(
        "standing in the cut", changed("G1 X52 F1500", "G1 X20 F1500\nG4 P2\nG1 X52"), WARNS
    ),
    "side of the cut deeper than the flutes": Fault(
        "depth of cut to flutes", changed(CUT, "G0 X-12 Y-6\nG0 Z42\nG1 Z2 F3000\nG1 X52 F800\n"),
        tool={"holder_mm": [[60, 18], [100, 50]]},
    ),
    "no spindle after the tool change": Fault(
        "spindle in the cut", changed(END, "G0 Z60\nM6 T2\nG43 H2\nG0 X-12\nG1 Z34 F1200\nG1 X52\n" + END)
    ),
    "cut before the spindle has its speed": Fault(
        "spindle run-up", changed("M3 S13000\nG0 Z60\n", "G0 Z60\n", changed("G1 Z36", "M3 S13000\nG1 Z36")), WARNS,
        cell={"process_limits": {"spindle_run_up_s": 3.0}},
    ),
    "new speed in the cut": Fault(
        "spindle run-up", changed("G1 X52 F1500", "G1 X20 F1500\nS12000\nG1 X52"), WARNS
    ),
    "run-up of an unknown spindle": Fault(
        "spindle run-up", CLEAN, NAMED, cell={"process_limits": {"spindle_run_up_s": None}}
    ),
    "spindle left on": Fault("end of the program", changed("M5\nM30\n", "%\n", "%\n" + CLEAN), WARNS),
}  # fmt: skip


WAITS = {
    "src": ("LIN {X 72.000", "LIN {X 30.000,Y 15.000,Z 34.000,A 180.000,B 0.000,C 180.000}\n{}\nLIN {X 72.000",
            ("HALT", "WAIT FOR $IN[3]", "WAIT FOR NOT $IN[3]"), ("WAIT FOR TRUE", "WAIT SEC 0.2")),
    "mod": ("SetDO doChips,1;", "MoveL Offs(pIn,40,0,0),vMill,fine,tMill\\WObj:=wobjPart;\n{}",
            ("Stop;", "WaitDI diOk,1;", "WaitUntil diOk=1;"), ("WaitTime 0.2;", "SetDO doChips,1;")),
}  # fmt: skip


@pytest.mark.parametrize("ending", WAITS)
def test_a_robot_program_that_waits_in_the_cut_is_named(ending: str, tmp_path: Path, cell: Callable[..., Cell]) -> None:
    source = EXAMPLES / f"groove.{ending}"
    old, new, waits, others = WAITS[ending]
    (tmp_path / "groove.dat").write_text(source.with_suffix(".dat").read_text())
    found = {}
    for text in (*waits, *others):
        program = source.read_text()
        assert old in program
        (tmp_path / source.name).write_text(program.replace(old, new.replace("{}", text), 1))
        table = job.check(tmp_path / source.name, cell()).summary["checks"]
        found[text] = next(row["verdict"] for row in table if row["check"] == "standing in the cut")
    assert found == dict.fromkeys(waits, "warning") | dict.fromkeys(others, "ok")


@pytest.fixture
def cell() -> Callable[..., Cell]:
    def make(fault: Fault | None = None) -> Cell:
        data = tomllib.loads(SMALL.read_text(encoding="utf-8"))
        for tables in (STATED, {} if fault is None else fault.cell):
            for name, values in tables.items():
                data.setdefault(name, {}).update(values)
        tool = T1 | ({} if fault is None else fault.tool)
        data["tools"] = [{k: v for k, v in table.items() if v is not None} for table in (tool, T2)]
        return resolve(parse(CellTables, data, where="test"), SMALL)

    return make


def rows_of(folder: Path, program: str, cell: Cell) -> dict[str, dict[str, Any]]:
    (folder / "part.ngc").write_text(program)
    return {row["check"]: row for row in job.check(folder / "part.ngc", cell).summary["checks"]}


@pytest.mark.by_turn
@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_stopped_or_named(name: str, tmp_path: Path, cell: Callable[..., Cell]) -> None:
    fault = FAULTS[name]
    try:
        row = rows_of(tmp_path, fault.program, cell(fault))[fault.check]
    except ProgramError as refusal:
        if fault.check == "work offset" and "offset" in str(refusal):
            return  # a reader that refuses an offset that nobody defined stops it as well
        raise
    assert row["verdict"] in fault.verdicts, row
    assert row["missing"] or row["advice"] or row["what"]


def test_there_are_forty_faults_of_most_hazards() -> None:
    assert len(FAULTS) >= 40
    assert len({fault.check for fault in FAULTS.values()}) >= 25


def test_without_a_fault_everything_is_looked_at_and_quiet(tmp_path: Path, cell: Callable[..., Cell]) -> None:
    rows = rows_of(tmp_path, CLEAN, cell())
    assert [row["check"] for row in rows.values()] == [hazard.check for hazard in HAZARDS]
    assert {check: row["verdict"] for check, row in rows.items() if row["verdict"] != "ok"} == {}
