"""What the reader keeps of a program: blocks, words, modes, offsets, subroutine files, listing and tool path."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from counterflex.core.errors import OutputError, ProgramError
from counterflex.core.units import MM, RPM
from counterflex.path.toolpath import FEED, RAPID
from counterflex.programs.compensated import tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode, read_gcode_file
from counterflex.programs.listing import SCHEMA, listing, write_listing
from counterflex.programs.program import Program

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "programs"


def ends_mm(program: Program) -> list[list[float]]:
    return [[round(float(value) / MM, 6) + 0.0 for value in motion.p_end] for motion in program.motions]


def test_blocks_keep_text_words_and_their_places() -> None:
    text = "G21 G90 (set up)\n\nn10 g1 x[1 + 1] Y-.5 f1 00 ; go\nM2"
    program = read_gcode(text, name="a.ngc")
    assert program.lines == tuple(text.split("\n"))
    assert [block.line for block in program.blocks] == [1, 2, 3, 4]
    block = program.blocks[2]
    shown = [(word.letter, word.value, block.text[word.start : word.end], word.literal) for word in block.words]
    assert shown == [
        ("N", 10.0, "n10", True), ("G", 1.0, "g1", True), ("X", 2.0, "x[1 + 1]", False), ("Y", -0.5, "Y-.5", True),
        ("F", 100.0, "f1 00", True),
    ]  # fmt: skip
    assert (block.first_motion, block.motion_count, block.single, block.cycle) == (0, 1, True, False)
    assert program.straight
    assert program.newline == "\n"


def test_windows_line_ends_are_kept_apart_from_the_text() -> None:
    program = read_gcode("G21\r\nG0 X1\r\nM2\r\n")
    assert program.newline == "\r\n"
    assert program.lines == ("G21", "G0 X1", "M2", "")
    assert len(program.blocks) == 3


def test_modal_state_of_each_block() -> None:
    program = read_gcode(
        "G21 G90 G17\nT4 M6\nG10 L2 P2 X10 Y20 Z30\nS800 M4\nG55 G0 X1\nG20 G91 G18\nG92 X0\nG53 G90 G0 Z1\nM5\nM2"
    )
    modal = [block.modal for block in program.blocks]
    assert (modal[0].motion, modal[0].plane, modal[0].unit_m, modal[0].absolute) == ("G80", 17, 0.001, True)
    assert modal[1].tool == 4
    assert modal[3].spindle_rpm == -800.0
    assert modal[4].motion == "G0"
    assert modal[4].p_part_origin == pytest.approx((0.010, 0.020, 0.030))
    assert (modal[5].plane, modal[5].unit_m, modal[5].absolute) == (18, 0.0254, False)
    assert modal[6].p_part_origin == pytest.approx((0.011, 0.020, 0.030))
    assert modal[7].p_part_origin == (0.0, 0.0, 0.0)
    assert modal[8].spindle_rpm == 0.0
    assert program.motions[0].spindle_rad_s == pytest.approx(-800.0 * RPM)


def test_target_is_origin_plus_value_in_every_absolute_block() -> None:
    program = read_gcode_file(ROOT / "tests" / "data" / "gcode" / "corpus" / "offsets.ngc")
    checked = 0
    for block in program.blocks:
        if block.motion_count != 1 or block.cycle or not block.modal.absolute:
            continue
        end = program.motions[block.first_motion].p_end
        for word in block.words:
            if word.letter in "XYZ":
                axis = "XYZ".index(word.letter)
                expected = block.modal.p_part_origin[axis] + word.value * block.modal.unit_m
                assert end[axis] == pytest.approx(expected, abs=1e-12)
                checked += 1
    assert checked > 25


def test_loops_and_calls_are_marked() -> None:
    program = read_gcode(
        "G21 G0 X0\no1 sub\nG0 Y#1\no1 endsub\no2 repeat [2]\nG91 G0 X1\nG90\no2 endrepeat\no1 call [3]\nG0 Z1\nM2"
    )
    assert not program.straight
    assert ends_mm(program) == [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 3, 0], [2, 3, 1]]
    single = {block.line: block.single for block in program.blocks}
    assert single[1]
    assert not single[6]
    assert not single[3]
    assert single[10]


def test_cycles_are_marked_and_hold_their_motions() -> None:
    program = read_gcode("G21 G90 F100 G0 Z10\nG99 G81 X5 Z-5 R2\nX6\nG80\nM2")
    assert [(block.cycle, block.motion_count) for block in program.blocks] == [
        (False, 1), (True, 4), (True, 3), (False, 0), (False, 0),
    ]  # fmt: skip
    assert all(program.blocks[motion.block].first_motion <= i for i, motion in enumerate(program.motions))


def test_given_offsets_lengths_and_parameters() -> None:
    program = read_gcode(
        "G21 G90 T2 M6 G43 H2\nG0 X1 Z#<_safe>\nG53 G0 Z0\nG28\nM2",
        machine=MillingMachine(
            work_offsets={"G54": (0.1, 0.2, 0.3)},
            tool_lengths={2: 0.05},
            parameters={"_safe": 7.0, 5161: 1.0, "#5162": 2.0, 5163: 90.0},
        ),
    )
    assert ends_mm(program) == [[101, 0, 307 - 50 + 50], [101, 0, -50], [1, 2, 40]]


def test_tool_length_is_nothing_by_default() -> None:
    program = read_gcode("G21 G90 G0 Z5\nT9 M6\nG43 H9\nG0 Z4\nM2")
    assert ends_mm(program) == [[0, 0, 5], [0, 0, 4]]
    assert program.motions[1].tool == 9


def test_block_delete_is_a_setting() -> None:
    text = "G21 G0 X1\n/G0 X2\nM2"
    assert len(read_gcode(text).motions) == 2
    assert len(read_gcode(text, block_delete=True).motions) == 1
    assert len(read_gcode(text, block_delete=True).blocks) == 3


def test_subroutine_files(tmp_path: Path) -> None:
    (tmp_path / "drill.ngc").write_text("o<drill> sub\nG0 X#1\no<drill> endsub [#1 * 2]\nM2\n", encoding="ascii")
    main = tmp_path / "main.ngc"
    main.write_text("G21\no<drill> call [4]\nG0 Y#<_value>\nM2\n", encoding="ascii")
    program = read_gcode_file(main)
    assert ends_mm(program) == [[4, 0, 0], [4, 8, 0]]
    assert not program.straight
    with pytest.raises(ProgramError, match="not defined"):
        read_gcode(main.read_text(encoding="ascii"))
    files = {"a": ("a.ngc", "o<a> sub\nG0 X3\no<a> endsub")}
    assert ends_mm(read_gcode("G21\no<a> call\nM2", includes=files.get)) == [[3, 0, 0]]


def test_subroutine_files_stay_beside_the_program(tmp_path: Path) -> None:
    (tmp_path / "out.ngc").write_text("o<../out> sub\nG0 X1\no<../out> endsub\nM2\n", encoding="ascii")
    (tmp_path / "in").mkdir()
    main = tmp_path / "in" / "main.ngc"
    main.write_text("G21\no<../out> call\nM2\n", encoding="ascii")
    with pytest.raises(ProgramError, match="not defined"):
        read_gcode_file(main)


def test_an_error_in_a_subroutine_file_names_that_file() -> None:
    with pytest.raises(ProgramError, match=r"a\.ngc:2:4: the word appears twice|a\.ngc:2:7"):
        read_gcode("G21\no<a> call\nM2", includes=lambda _: ("a.ngc", "o<a> sub\nG0 X3 X4\no<a> endsub"))


def test_constant_surface_speed_follows_x() -> None:
    program = read_gcode("G21 G90 G0 X100\nG96 D2000 S200 M3\nF100 G1 X50\nX1\nG97 S300\nX2\nM2")
    speeds = [motion.spindle_rad_s / RPM for motion in program.motions]
    assert speeds == pytest.approx([0.0, 200.0 / (2 * math.pi * 0.05), 2000.0, 300.0])


def test_feed_modes() -> None:
    program = read_gcode("G21 G90\nG94 F600 G1 X10\nG93 X20 F2\nG95 F0.2 S1200 M3\nX30\nG94\nG1 F360 A90\nM2")
    feeds = [motion.feed_m_s * 60e3 for motion in program.motions]
    assert feeds == pytest.approx([600.0, 20.0, 240.0, 0.0])
    assert program.motions[-1].feed_rad_s == pytest.approx(math.radians(360.0) / 60.0)


def test_uninitialised_arguments_of_a_subroutine_are_zero() -> None:
    program = read_gcode("G21\n#1=5\no1 sub\nG0 X[#1 + #2 + 1]\no1 endsub\no1 call\nG0 X#1\nM2")
    assert ends_mm(program) == [[1, 0, 0], [5, 0, 0]]


def test_machine_parameters_answer() -> None:
    program = read_gcode(
        "G21 G90\nG10 L2 P2 X10\nG55 T3 M6\nG43.1 Z5\nG0 X1\nG0 Y#5220 Z#5403\nG0 X#5241 Y#5400 Z#<_current_tool>\nM2"
    )
    assert ends_mm(program)[1:] == [[11, 2, 5], [20, 3, 3]]


def test_polyline_of_examples_is_continuous() -> None:
    for path in sorted(EXAMPLES.glob("*.ngc")):
        program = read_gcode_file(path)
        assert program.straight
        assert len(program.motions) > 5
        for before, after in zip(program.motions, program.motions[1:], strict=False):
            assert after.p_start.tolist() == before.p_end.tolist()
            assert not after.p_end.flags.writeable


def test_pocket_path_has_its_known_size() -> None:
    """Pocket of diameter 70 with a 16 mm cutter about (55, 118): written as I-19.0903 J-19.0903, and 6 mm deep."""
    program = read_gcode_file(EXAMPLES / "fc_grooves_pocket.ngc")
    path = tool_path(program, step_m=5e-4)
    cut = path.p_part_tcp[(path.kind == FEED) & (path.p_part_tcp[:, 1] > 0.08)]
    assert np.hypot(cut[:, 0] - 0.055, cut[:, 1] - 0.118).max() == pytest.approx(0.0190903 * math.sqrt(2.0), abs=2e-7)
    assert cut[:, 2].min() == pytest.approx(0.034)


def test_tool_path_of_a_program() -> None:
    program = read_gcode("G21 G90 S600 M3 T1\nG0 X10\nG1 X20 F600\nG4 P2\nG3 X20 Y20 J10\nM2")
    path = tool_path(program, step_m=1e-3, rapid_speed_m_s=0.1)
    assert path.kind[:2].tolist() == [RAPID, RAPID]
    assert path.time_s[-1] == pytest.approx(0.1 + 1.0 + 2.0 + math.pi, rel=1e-9)
    assert path.motion[-1] == 3
    assert np.all(path.axis_part == [0.0, 0.0, 1.0])
    arc = path.p_part_tcp[path.motion == 3]
    assert np.hypot(arc[:, 0] - 0.02, arc[:, 1] - 0.01) == pytest.approx(np.full(len(arc), 0.01), abs=1e-12)


def test_rotary_motion_is_listed_but_makes_no_tool_path() -> None:
    program = read_gcode("G21 G90 F100\nG1 X5 A30\nM2", name="rot.ngc")
    assert listing(program)["a_deg"].to_list() == [30.0]
    with pytest.raises(ProgramError, match=r"rot\.ngc:2:1: the program moves a rotary axis.*30"):
        tool_path(program)
    assert len(tool_path(read_gcode("G21 G90 F100\nG1 X5 A0 B0\nM2"))) > 2


def test_listing_columns_and_values(tmp_path: Path) -> None:
    program = read_gcode("G21 G90 F250 S100 M4\nG0 X1\nG18 G2 X3 K0 I1\nG4 P.5\nG1 A5\nG17 G3 X3 Y0 Z-1 I-1 P2\nM2")
    table = listing(program)
    assert table.schema == pl.Schema(SCHEMA)
    assert table["motion"].to_list() == ["rapid", "arc", "dwell", "feed", "arc"]
    assert table["line"].to_list() == [2, 3, 4, 5, 6]
    assert table["feed_mm_min"].to_list() == [None, 250.0, None, None, 250.0]
    assert table["plane"].to_list() == [None, "G18", None, None, "G17"]
    assert table["turns"].to_list() == [None, -0.5, None, None, 2.0]
    assert table["centre_x_mm"].to_list() == [None, 2.0, None, None, 2.0]
    assert table["dwell_s"].to_list() == [None, None, 0.5, None, None]
    assert table["spindle_rpm"].to_list() == [-100.0] * 5
    target = tmp_path / "list.csv"
    assert write_listing(program, target) == 5
    rows = list(csv.DictReader(target.read_text(encoding="utf-8").splitlines()))
    assert list(rows[0]) == list(SCHEMA)
    assert rows[1]["x_mm"] == "3.0"
    assert rows[0]["turns"] == ""


def test_listing_into_a_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="ascii")
    with pytest.raises(OutputError):
        write_listing(read_gcode("G21 G0 X1\nM2"), tmp_path / "file" / "list.csv")


@pytest.mark.parametrize(
    "head", ["%1", "%1234 (PART)", "% part_1.nc", "(head)\n\n%", "; head\n%\nO1", "%prog1\n(uccnc)"]
)
@pytest.mark.parametrize("end", ["M30\n%\n", "M30\n", "%\n"])
def test_the_program_sign_of_din_66025(head: str, end: str) -> None:
    """A number or a name may stand behind it, comments before it; FreeCAD's posts write all of these."""
    program = read_gcode(f"{head}\nG21 G90 G0 X0 Y0 Z5\nG1 X1 F60\n{end}")
    assert [tuple(np.round(m.p_end * 1e3, 6)) for m in program.motions] == [(0, 0, 5), (1, 0, 5)]


@pytest.mark.parametrize("text", ["%1\nG21 G90 G0 X1\n%2\nG0 X2\nM30\n", "G21 G90 G0 X1\n%2\nG0 X2\nM30\n"])
def test_a_second_program_in_the_file_is_refused(text: str) -> None:
    with pytest.raises(ProgramError, match="another program begins in the same file; got %2"):
        read_gcode(text)


@pytest.mark.parametrize("text", [
    "%\n:1001\nG21 G90 G0 X0 Y0 Z5\nG1 X1 F60\nM30\n%\n",
    "%\n:1001(PART)\nG21 G90 G0 X0 Y0 Z5\nG1 X1 F60\nM30\n%\n",
    "%\n<PART-7.NC>\nG21 G90 G0 X0 Y0 Z5\nG1 X1 F60\nM30\n%\n",
    "G21 G90 G0 X0 Y0 Z5\n/2 G1 X1 F60\nM30\n",
    "G21 G90 G0 X0 Y0 Z5\n/9G1 X1 F60\nM30\n",
    "G21 G90 G0 X0 Y0 Z5\nM98 P1001\nM30\n:1001\nG1 X1 F60\nM99\n",
])  # fmt: skip
def test_fanuc_spellings_of_numbers_names_and_switches(text: str) -> None:
    ends = [tuple(np.round(m.p_end * 1e3, 6)) for m in read_gcode(text).motions]
    assert ends == [(0, 0, 5), (1, 0, 5)]


def test_k_repeats_a_cycle_as_l_does() -> None:
    """Fanuc repeats by K, LinuxCNC and Haas by L."""
    text = "G21 G90 G0 X0 Y0 Z20\nG91 G99 G81 X1 Z-7 R-18 F100 {}3\nG80\nM30\n"
    k, ell = (read_gcode(text.format(letter)) for letter in "KL")
    assert [tuple(m.p_end) for m in k.motions] == [tuple(m.p_end) for m in ell.motions]
    assert round(k.motions[-1].p_end[0] * 1e3) == 3


@pytest.mark.parametrize(("word", "reason"), [
    ("X1,5", "decimal comma"), ("X1 ,C2", "chamfers"), ("X1,R.5", "rounded corners"), ("X1 $H", "GRBL"),
])  # fmt: skip
def test_what_stands_where_a_letter_must_be_is_named(word: str, reason: str) -> None:
    with pytest.raises(ProgramError, match=reason):
        read_gcode(f"G21 G90 G0 X0 Y0 Z5\nG1 {word} F60\nM30\n")


FANUC_ROW = "%\nO0007\nG21 G90 G0 X0 Y0 Z20\n{}G81 X0 Y0 Z-5 R2 F100\nG91 X10 {}\nG90 G80\nM30\n%\n"


def heights_mm(text: str) -> list[float]:
    return [end[2] for end in ends_mm(read_gcode(text))[1:]]


@pytest.mark.parametrize(
    "text", [FANUC_ROW.format("G99 ", "L2"), FANUC_ROW.format("G99 ", "K2").replace("O0007\n", "")]
)
def test_a_row_of_holes_of_fanuc_keeps_the_heights_of_g90(text: str) -> None:
    """Haas, Mill Operator's Manual, "Looping canned cycles": Z and R stay where they were, X counts on."""
    assert heights_mm(text) == [20, 2, -5, 2, 2, -5, 2, 2, -5, 2]
    assert ends_mm(read_gcode(text))[-1][0] == 20.0


def test_linuxcnc_counts_the_same_heights_by_the_mode_in_force() -> None:
    """R 2 above the initial height of 20, Z 5 below R."""
    text = FANUC_ROW.format("G99 ", "L2").replace("O0007\n", "")
    assert heights_mm(text)[4:] == [22, 22, 17, 22, 22, 17, 22]


def test_fanuc_begins_with_the_return_to_the_initial_height() -> None:
    """G98 is in force at the start of Fanuc and Haas, G99 of LinuxCNC."""
    assert heights_mm(FANUC_ROW.format("", "L1"))[3:5] == [20.0, 20.0]
    assert heights_mm(FANUC_ROW.format("", "L1").replace("O0007\n", ""))[3] == 2.0


def test_heights_of_g91_are_not_taken_over_under_g90() -> None:
    text = "%\nO0007\nG21 G90 G0 X0 Y0 Z20\nG91 G81 X5 Z-11 R-15 F100\nG90 X9\nM30\n%\n"
    with pytest.raises(ProgramError, match=r"5:1: G81 under G90 takes over a height of G91.*got R-15"):
        read_gcode(text)


@pytest.mark.parametrize(
    ("value", "fanuc", "linuxcnc"), [("FIX[-1.2]", -1, -2), ("FUP[-1.2]", -2, -1), ("FIX[1.8]", 1, 1)]
)
def test_fanuc_cuts_fractions_off_by_size(value: str, fanuc: float, linuxcnc: float) -> None:
    """FANUC Series 30i, Operator's Manual, "Arithmetic and logic operation", rounding up and down of -1.2."""
    text = "{}G21 G90 G0 X0 Y0 Z5\n#1=" + value + "\nG1 X#1 F60\nM30\n"
    assert ends_mm(read_gcode(text.format("%\nO1\n") + "%\n"))[-1][0] == fanuc
    assert ends_mm(read_gcode(text.format("")))[-1][0] == linuxcnc


@pytest.mark.parametrize(("line", "reason"), [
    ("#1=6 AND 3", "combine the bits of these numbers.*got 6 AND 3"), ("#1=5 OR 2", "got 5 OR 2"),
    ("G1 X[ROUND[1.00333]+1] F60", r"4:4: ROUND in a word.*got X\[ROUND"),
])  # fmt: skip
def test_arithmetic_in_which_controllers_differ_is_refused_in_programs_of_fanuc(line: str, reason: str) -> None:
    """Haas, Mill Operator's Manual, "Macros": AND and OR work on bits; ROUND in an address keeps the precision."""
    with pytest.raises(ProgramError, match=reason):
        read_gcode(f"%\nO1\nG21 G90 G0 X0 Y0 Z5\n{line}\nM30\n%\n")
    read_gcode("%\nO1\nG21 G90 G0 X0 Y0 Z5\n#1=[1 EQ 1] AND [2 EQ 2]\n#2=ROUND[#1]\nM30\n%\n")
