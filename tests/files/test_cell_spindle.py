"""Spindle, coolant and tool change of a cell: statements by M-code, in the robot's language; what is not mapped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from counterflex.app import examples
from counterflex.core.errors import FileFormatError, ProgramError
from counterflex.files.cell.cell import read_cell
from counterflex.files.schema import read_toml
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.robot_writer.machine_functions import only_said

KRL = {
    "clockwise": ["$ANOUT[1]={s}/24000.0", "$OUT[17]=TRUE"],
    "off": ["$OUT[17]=FALSE"],
    "ready": "$IN[17]",
    "standing": "$IN[18]",
    "flood": ["COOLANT({t})"],
    "coolant_off": [],
    "tool_change": ["CHANGE({t},{d})"],
    "m_codes": {"M51": ["$OUT[20]=TRUE"]},
}
RAPID = {"clockwise": ["SetAO aoSpeed,{s};"], "off": ["SetDO doSpindle,0;"], "ready": "diReady=1", "tool_change": []}


def lines(folder: Path, text: str, language: str, **tables: Any) -> list[list[str]]:
    """What each block of a program gives that does not only move."""
    (folder / "cell.toml").write_text(examples.text("cell.toml"), encoding="utf-8")
    data = read_toml(folder / "cell.toml")
    data["tools"] = [{**data["tools"][0], "number": n, "tool_data": n + 4} for n in (1, 2)]
    data["controller"] = {**data.get("controller", {}), "spindle": {"wait_s": 9.0, **tables}}
    (folder / "cell.toml").write_text(tomli_w.dumps(data), encoding="utf-8")
    functions = read_cell(folder / "cell.toml").machine_functions(language)
    found = [functions.lines(block) for block in read_gcode(text, name="p.ngc").blocks]
    return [item for item in found if item]


def test_statements_of_a_program(tmp_path: Path) -> None:
    text = "G21 G90\nT2 M6\nM3 S12000 M8\nG1 X10 F600\nS6000\nG1 X0\nM9 M5\nM2\n"
    change, start, faster, stop = lines(tmp_path, text, "krl", krl=KRL)
    assert change == ["WAIT SEC 0.0", "CHANGE(2,6)"]
    assert start[:3] == ["WAIT SEC 0.0", "$ANOUT[1]=12000/24000.0", "$OUT[17]=TRUE"]
    assert start[-1] == "COOLANT(2)"
    assert start.index("WHILE NOT ($IN[17])") < start.index("IF $TIMER[20]>9000 THEN") < start.index("COOLANT(2)")
    assert "$ANOUT[1]=6000/24000.0" in faster
    assert stop[1] == "$OUT[17]=FALSE"
    assert "WHILE NOT ($IN[18])" in stop


def test_by_hand_the_program_stops(tmp_path: Path) -> None:
    change, start = lines(tmp_path, "T2 M6\nM3 S9000\nM2\n", "rapid", rapid=RAPID)
    assert change == ['TPWrite "change to tool T2, then press start";', "Stop;"]
    assert start == ["SetAO aoSpeed,9000;", "WaitUntil diReady=1\\MaxTime:=9;"]
    (started,) = lines(tmp_path, "M3 S9000\nM2\n", "krl", krl={"clockwise": []})
    assert started[-1].startswith("HALT ;")


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("M4 S100\n", "controller.spindle.krl.counter_clockwise"),
        ("M7\n", "controller.spindle.krl.mist"),
        ("M3\n", "without a speed"),
        ("T1 M6\nT7 M6\n", "tools.tool_data of T7"),
    ],
)
def test_what_is_not_mapped_names_the_key(tmp_path: Path, text: str, key: str) -> None:
    with pytest.raises(ProgramError, match=key.replace(".", r"\.")):
        lines(tmp_path, text + "M2\n", "krl", krl=KRL)


def test_without_a_table_everything_is_unmapped(tmp_path: Path) -> None:
    for code, key in (("M3 S1", "clockwise"), ("M5", "off"), ("M8", "flood"), ("M9", "coolant_off"), ("T1 M6", "tool")):
        with pytest.raises(ProgramError, match=rf"controller\.spindle\.rapid\.{key}"):
            lines(tmp_path, f"{code}\nM2\n", "rapid")
    assert lines(tmp_path, "G1 X1 F100\nM0\nM2\n", "rapid") == []


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"krl": {"clockwise": ["$OUT[1]={rpm}"]}}, "stands for nothing"),
        ({"krl": {"m_codes": {"M3": ["A()"]}}}, "clockwise"),
        ({"krl": {"m_codes": {"M30": ["A()"]}}}, "cannot be mapped"),
        ({"krl": {"m_codes": {"spindle": ["A()"]}}}, "is no M-code"),
        ({"krl": {"off": ["A()\nB()"]}}, "one line"),
        ({"rapid": {"off": ["SetDO doSpindle,0"]}}, "semicolon"),
        ({"rapid": {"ready": "diReady=1;"}}, "condition"),
        ({"krl": {"clockwize": ["A()"]}}, "clockwise"),
        ({"wait_s": 0.0}, "wait_s"),
    ],
)
def test_tables_are_strict(tmp_path: Path, tables: dict[str, Any], said: str) -> None:
    with pytest.raises(FileFormatError, match=said):
        lines(tmp_path, "M2\n", "krl", **tables)


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (["; M3 S13000", "LIN {X 1}"], 0),
        (["; N40 G1 X1 M03 S13000 F600", "; next", "$VEL.CP=0.25", "LIN {X 1}"], 0),
        (["PTP XSTART", "; T2 M6", "$TOOL=TOOL_DATA[2]"], 1),
        (["; M4 S100"], 0),
        (["; M3 S13000", "WAIT SEC 0.0", "$OUT[17]=TRUE"], None),
        (["; M3 S13000", "HALT ; start the spindle"], None),
        (["; (M3 screws)", "LIN {X 1}"], None),
        (["; M3 screws at X 10", "LIN {X 1}"], None),
        (["; M30", "END"], None),
        (["; M8", "LIN {X 1}"], None),
        (["! M6 T1", "SetDO doTool,1;"], None),
        (["! M6 T1", "    MoveL p,v,fine,t;"], 0),
    ],
)
def test_a_spindle_that_is_started_by_a_comment_is_found(lines: list[str], found: int | None) -> None:
    assert only_said(lines, lines[0][0] if lines[0][0] in ";!" else ";") == found
