"""Several tools in a robot program, from the cell file: found before anything is planned, written part by part."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.compensation.robot_program import check_machine, omissions, other_lengths, routine_name, tool_data
from counterflex.app.inputs import read_job
from counterflex.core.errors import FileFormatError, InputError, ProgramError
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse
from counterflex.integrations.abb.language.writer import RapidSettings

CELL = Path(__file__).resolve().parents[2] / "data" / "cells" / "small.toml"
MAPPED: dict[str, list[str]] = {"clockwise": [], "off": [], "tool_change": [], "flood": [], "coolant_off": []}
TWO = (
    "G21 G90\nT1 M6\nM3 S9000 M8\nG0 X-12 Y15 Z50\nG0 Z38\nG1 X2 F1500\nG0 Z50\n"
    "T2 M6\nM3 S9000\nG0 Z38\nG1 X6\nG0 Z50\nM30\n"
)


def cell(*tools: dict[str, Any], **spindle: Any) -> Cell:
    data = tomllib.loads(CELL.read_text(encoding="utf-8"))
    data["tools"] = [{**data["tools"][0], "number": number, **keys} for number, keys in enumerate(tools, start=1)]
    data["controller"] = {**data.get("controller", {}), "spindle": spindle}
    return resolve(parse(CellTables, data, where="test"), CELL)


def program(folder: Path, text: str = TWO) -> Path:
    file = folder / "two.ngc"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(("language", "key"), [("krl", "tool_data"), ("rapid", "tooldata")])
def test_a_tool_without_a_frame_is_refused_before_planning(tmp_path: Path, language: str, key: str) -> None:
    """It would run with the other one's length."""
    job_cell = cell({"tool_data": 3, "tooldata": "tOne"}, {}, krl=MAPPED, rapid=MAPPED)
    with pytest.raises(ProgramError, match=rf"T2; expected tools\.{key} of T2") as caught:
        check_machine(read_job(program(tmp_path), job_cell), job_cell, language)
    assert caught.value.where == "two.ngc:10"


def test_one_tool_needs_no_frame_of_its_own(tmp_path: Path) -> None:
    job_cell = cell({}, {"tool_data": 9}, krl=MAPPED)
    job = read_job(program(tmp_path, TWO.replace("T2 M6\n", "")), job_cell)
    check_machine(job, job_cell, "krl")
    assert tool_data(job.program, job_cell, "krl") == {}


@pytest.mark.parametrize("language", ["krl", "rapid"])
def test_what_is_not_mapped_names_file_line_and_key(tmp_path: Path, language: str) -> None:
    job_cell = cell({"tool_data": 3, "tooldata": "tOne"}, {"tool_data": 4, "tooldata": "tTwo"})
    with pytest.raises(ProgramError, match=rf"controller\.spindle\.{language}\.tool_change") as caught:
        check_machine(read_job(program(tmp_path), job_cell), job_cell, language)
    assert caught.value.where == "two.ngc:2"


@pytest.mark.parametrize("language", ["krl", "rapid"])
def test_everything_that_is_not_mapped_is_named_at_once(tmp_path: Path, language: str) -> None:
    """Else a shop mends its cell file line by line, and starts anew for each."""
    job_cell = cell({"tool_data": 3, "tooldata": "tOne"}, {"tool_data": 4, "tooldata": "tTwo"})
    text = TWO.replace("M30", "M51\nM30")
    with pytest.raises(ProgramError) as caught:
        check_machine(read_job(program(tmp_path, text), job_cell), job_cell, language)
    keys = ("clockwise", "off", "tool_change", "flood", "coolant_off", "m_codes.M51")
    assert all(f"controller.spindle.{language}.{key}" in str(caught.value) for key in keys)
    assert "M51 (line 13)" in str(caught.value)
    assert caught.value.where == "two.ngc:2"


def test_every_tool_without_a_frame_is_named_at_once(tmp_path: Path) -> None:
    job_cell = cell({}, {}, krl=MAPPED)
    with pytest.raises(ProgramError, match=r"2 of them have; got T1, T2; expected tools\.tool_data of T1, T2"):
        check_machine(read_job(program(tmp_path), job_cell), job_cell, "krl")


def test_the_stop_at_the_end_must_be_mapped_too(tmp_path: Path) -> None:
    """M30 stops spindle and coolant; the program does not write M9."""
    job_cell = cell({}, krl={key: MAPPED[key] for key in MAPPED if key != "coolant_off"})
    job = read_job(program(tmp_path, TWO.replace("T2 M6\n", "")), job_cell)
    with pytest.raises(ProgramError, match=r"controller\.spindle\.krl\.coolant_off"):
        check_machine(job, job_cell, "krl")


def test_gcode_keeps_its_words_without_any_table(tmp_path: Path) -> None:
    found = compensate(program(tmp_path), cell({}, {}), predict=False)
    assert "T2 M6" in found.files["two.ngc"]


def test_a_part_per_tool(tmp_path: Path) -> None:
    job_cell = cell({"tool_data": 3}, {"tool_data": 4}, krl=MAPPED)
    found = compensate(program(tmp_path), job_cell, language="krl", predict=False)
    assert sorted(found.files) == sorted(f"two{part}.{end}" for part in ("", "_001", "_002") for end in ("dat", "src"))
    second = found.files["two_002.src"].splitlines()
    assert "$TOOL=TOOL_DATA[4]" in second
    assert "HALT ; change to tool T2, then press start" in second[: second.index("$TOOL=TOOL_DATA[4]")]
    assert "HALT ; stop the spindle, then press start" in found.files["two_001.src"]  # M6 stops it on a machine


def test_a_tool_is_not_changed_in_the_cut(tmp_path: Path) -> None:
    """M6 takes a milling machine out of the material first; a robot would stand there, and come back into it."""
    job_cell = cell({"tool_data": 3}, {"tool_data": 4}, krl=MAPPED)
    text = TWO.replace("G1 X2 F1500\nG0 Z50\n", "G1 X2 F1500\n")
    with pytest.raises(ProgramError, match="changed in the cut") as caught:
        check_machine(read_job(program(tmp_path, text), job_cell), job_cell, "krl")
    assert caught.value.where == "two.ngc:7"
    above = TWO.replace("G1 X2 F1500\nG0 Z50\n", "G1 X2 F1500\nG1 Z50\n")
    check_machine(read_job(program(tmp_path, above), job_cell), job_cell, "krl")


def test_another_length_than_that_of_the_tool_is_said(tmp_path: Path) -> None:
    job_cell = cell({"tool_data": 3}, {"tool_data": 4}, krl=MAPPED)
    text = TWO.replace("T1 M6\n", "T1 M6\nG43 H7\n").replace("T2 M6\n", "T2 M6\nG43 H2\n")
    (said,) = other_lengths(read_job(program(tmp_path, text), job_cell).program)
    assert "G43 H7 in line 3" in said
    assert "T1" in said


@pytest.mark.parametrize(
    ("stem", "name"),
    [("part", "part"), ("4 holes", "p_4_holes"), ("lin", "p_lin"), ("Bas", "p_Bas"), ("main", "p_main"), ("", "p_")],
)
def test_no_program_is_called_like_a_word_of_the_language(stem: str, name: str) -> None:
    """A cell.src would replace the controller's own; DEF lin( ) is none."""
    assert routine_name(stem) == name


def test_the_ways_home_are_one_warning(tmp_path: Path) -> None:
    text = "G21 G90\nT1 M6\nG0 X-12 Y15 Z50\nG0 Z38\nG1 X2 F1500\nG0 Z50\nG28 G91 Z0\nG90\nG53 G0 Z0\nG30\nM30\n"
    assert omissions(read_job(program(tmp_path, text), cell({})).program) == [
        "G28, G30, G53 in lines 7, 9, 10 lead to places of the milling machine: the robot stays where it is"
    ]
    one = text.replace("G90\nG53 G0 Z0\nG30\n", "")
    (said,) = omissions(read_job(program(tmp_path, one), cell({})).program)
    assert said.startswith("G28 in line 7 leads to")


def outputs(folder: Path, body: str, statements: dict[str, list[str]]) -> list[str]:
    mapped = {**MAPPED, "m_codes": statements}
    job_cell = cell({}, krl=mapped)
    file = program(folder, f"G21 G90\nT1 M6\nM3 S9000\nG0 X-12 Y15 Z50\n{body}\nG0 Z60\nM30\n")
    job = read_job(file, job_cell)
    check_machine(job, job_cell, "krl")
    functions = job_cell.machine_functions("krl")
    return [
        line for block in job.program.blocks for line in functions.lines(block) if "$OUT" in line or "$ANOUT" in line
    ]


def test_outputs_with_numbers_are_told_apart(tmp_path: Path) -> None:
    said = {"M62": ["$OUT[{p}]=TRUE"], "M67": ["$ANOUT[{e}]={q}"]}
    assert outputs(tmp_path, "M62 P1\nM62 P7\nM67 E2 Q0.5", said) == ["$OUT[1]=TRUE", "$OUT[7]=TRUE", "$ANOUT[2]=0.5"]


def test_one_statement_for_two_outputs_is_refused(tmp_path: Path) -> None:
    """Both would switch the same one."""
    assert outputs(tmp_path, "M62 P1\nM62 P1", {"M62": ["$OUT[11]=TRUE"]}) == ["$OUT[11]=TRUE"] * 2
    with pytest.raises(ProgramError, match=r"M62 is used with several values.*M62 P1, M62 P7.*\{p\} in") as caught:
        outputs(tmp_path, "M62 P1\nM62 P7", {"M62": ["$OUT[11]=TRUE"]})
    assert caught.value.where == "two.ngc:6"


@pytest.mark.parametrize(
    ("body", "good"),
    [
        ("G43.1 Z12.5\nG1 X2 F600", False),
        ("G43.1 Z12.5\nG0 X2", False),
        ("G43.1 Z12.5\nG91 G0 Z2\nG90", False),
        ("G43.1 Z12.5\nG0 Z40\nG1 X2 F600", True),
        ("G43 H1\nG1 X2 F600", True),
    ],
)
def test_a_length_that_changes_under_the_tool_moves_no_robot(tmp_path: Path, body: str, good: bool) -> None:
    job_cell = cell({}, krl=MAPPED)
    job = read_job(program(tmp_path, f"G21 G90\nT1 M6\nM3 S9000\nG0 X-12 Y15 Z50\n{body}\nG0 Z60\nM30\n"), job_cell)
    if good:
        check_machine(job, job_cell, "krl")
    else:
        with pytest.raises(ProgramError, match="length was changed by 12.5 mm") as caught:
            check_machine(job, job_cell, "krl")
        assert caught.value.where == "two.ngc:6"


@pytest.mark.parametrize("name", ["MoveL", "pers", "tool0", "TOOLDATA"])
def test_a_word_of_rapid_is_no_tooldata(name: str) -> None:
    """It would stand in every MoveL of the program; tool0 is the flange without a tool."""
    with pytest.raises(FileFormatError, match=rf"tooldata.*{name} is a word of RAPID or the bare flange"):
        cell({"tooldata": name})


@pytest.mark.parametrize("name", ["two", "Two_m", "two_001", "t_two", "w_TWO", "v_two_3", "cfClock"])
def test_a_tooldata_called_as_what_the_program_declares_is_refused(name: str) -> None:
    settings = RapidSettings(name="two", start_axes_rad=[0.0] * 6, T_flange_tcp=np.eye(4), T_base_part=np.eye(4))
    replace(settings, tool_data={1: "two_tool"}).check()
    with pytest.raises(InputError, match="tooldata of T1 is called as something that the program declares"):
        replace(settings, tool_data={1: name}).check()


def test_a_program_is_not_called_as_its_start(tmp_path: Path) -> None:
    assert routine_name("xstart") == "p_xstart"


def test_a_word_that_the_block_does_not_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r"M62 with Q, for \{q\}"):
        outputs(tmp_path, "M62 P1", {"M62": ["$OUT[{q}]=TRUE"]})
