"""What a G-code program does not determine: offsets, places of the machine, parameters of the control.

Each is evaluated where something gives it, and refused with both lines, or marked, where it is used and nothing does.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import MM
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode, read_gcode_file
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.listing import listing
from counterflex.programs.program import Program
from counterflex.programs.stated.two_readings import doubtful_readings

HEAD = "G21 G90 G17 G54\nT1 M6\nS1000 M3 F600\nG0 X0 Y0 Z5\n"
OFFSETS = ("G54", "G55", "G59", "G59.3", "G54.1 P1", "G154 P7", "G54 P3", "G110")


def read(text: str, **machine: object) -> Program:
    return read_gcode(text, name="part.nc", machine=MillingMachine(known=False, **machine))  # type: ignore[arg-type]


def ends(program: Program) -> list[list[float]]:
    return [[round(float(x) / MM, 9) + 0.0 for x in motion.p_end] for motion in program.motions]


# Work offsets -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", OFFSETS)
def test_one_offset_that_never_changes_is_the_part_frame(offset: str) -> None:
    text = "G21 G90 *\nT1 M6\nG0 X0 Y0 Z5\nG1 Z-1 F300\n*\nX40\nM2\n"
    assert ends(read(text.replace("*", offset))) == ends(read(text.replace("*", "")))


@pytest.mark.parametrize("second", OFFSETS[1:])
def test_a_second_offset_that_nobody_gave_is_refused_where_it_is_selected(second: str) -> None:
    with pytest.raises(ProgramError, match=r"how far G5\S+( P\d)? lies from G54 \(line 4\) along X, Y, Z is not known"):
        read(f"{HEAD}{second}\nG0 X1\nM2\n")


def test_offsets_named_before_anything_moves_do_not_count() -> None:
    program = read("G21 G90 G54\nT1 M6\nG55\nG0 X0 Y0 Z5\nG55\nG0 X1\nM2\n")
    assert program.part_zero == ("G55", 4)
    assert any("G55 (line 4) is taken as the zero of the part" in text for text in doubtful_readings(program))
    assert not doubtful_readings(read(HEAD + "M2\n"))


def test_the_cell_gives_the_zeros_of_all_offsets_or_none() -> None:
    zeros = {"G54": (0.0, 0.0, 0.0), "G55": (0.1, 0.02, -0.003), "G54.1 P2": (0.3, 0.0, 0.0)}
    program = read(HEAD + "G55 G0 X1 Y1 Z1\nG154 P2\nX1\nG54\nX1 Y1\nM2\n", part_offsets=zeros)
    assert ends(program)[1:] == [[101, 21, -2], [301, 21, -2], [1, 1, -2]]
    assert program.part_zero is None
    with pytest.raises(ProgramError, match="how far G56 lies from the part along X, Y, Z is not known"):
        read("G21 G90 G56\nG0 X0 Y0 Z5\nM2\n", part_offsets=zeros)


def test_offsets_that_the_program_sets_are_known_relative_to_each_other() -> None:
    """The part is where G54 is; G55 lies 20 mm beside it in the machine."""
    text = "G21 G90\nG10 L2 P2 X-280 Y-200 Z-100\nG10 L2 P1 X-300 Y-200 Z-100\nG54\nG0 X1 Y2 Z3\nG55\nG0 X1 Y2 Z3\n"
    assert ends(read(text + "M2\n")) == [[1, 2, 3], [21, 2, 3]]
    moved = text + "G54\nG10 L2 P1 X-305 Y-200 Z-100\nG0 X1 Y2 Z3\nM2\n"
    assert ends(read(moved))[-1] == [-4, 2, 3]
    with pytest.raises(ProgramError, match="how far G55 lies from G54 .* along Z is not known"):
        read(text.replace("G10 L2 P2 X-280 Y-200 Z-100", "G10 L2 P2 X-280 Y-200") + "M2\n")


def test_l20_is_that_of_fanuc_in_a_program_that_uses_g54_1() -> None:
    text = "G21 G90\nG10 L2 P1 X-300 Y0 Z0\nG10 L20 P1 X-200 Y0 Z0\nG54 G0 X0 Y0 Z5\nG54.1 P1 G0 X0 Y0 Z5\nM2\n"
    assert ends(read(text)) == [[0, 0, 5], [100, 0, 5]]
    said = doubtful_readings(read(HEAD + "G10 L20 P1 X5\nG0 X0\nM2\n"))
    assert any("G10 L20 in line 5" in text for text in said)


@pytest.mark.parametrize("line", ["G92 X0", "G10 L20 P1 X0", "G91 G0 X5", "G68 R30", "G81 X1 Y1 Z-1 R2", "G2 X5 I2 F9"])
def test_nothing_counts_from_a_place_that_is_not_known(line: str) -> None:
    with pytest.raises(ProgramError, match=r"part.nc:2:\d+: .*not known"):
        read(f"G21 G90 F600\n{line}\nM2\n")


def test_a_cut_at_a_height_that_is_not_known_is_refused_and_listed() -> None:
    text = "G21 G90 F600\nG0 X0 Y0\nG1 X10\nM2\n"
    with pytest.raises(ProgramError, match=r"3:1: a feed motion while it is not known where the tool is along Z"):
        read(text)
    rows = listing(read(text, listed=True))
    assert rows["z_mm"].to_list() == [None, None]
    assert rows["x_mm"].to_list() == [0.0, 10.0]


@pytest.mark.parametrize("line", ["G1 Z-1", "G1 X5 Y5 Z-1", "G1 X5"])
def test_a_cut_does_not_begin_at_a_place_that_is_not_known(line: str) -> None:
    """Else the first rapid would run at the depth of the cut, where the tool never was."""
    with pytest.raises(ProgramError, match=r"3:1: a feed motion while it is not known where the tool is along Z"):
        read(f"G21 G90 F600\nG0 X0 Y0\n{line}\nM2\n")


@pytest.mark.parametrize("home", ["G53 G0 Z0", "G91 G28 Z0\nG90", "G91 G30 Z0\nG90"])
def test_a_list_of_motions_has_no_number_for_a_place_of_the_machine(home: str) -> None:
    text = f"{HEAD}G0 X72\n{home}\nG0 X1 Y1\nZ5\nG1 Z-1\nM2\n"
    rows = listing(read(text, listed=True))
    assert rows["z_mm"].to_list() == [5.0, 5.0, None, None, 5.0, -1.0]
    assert rows["x_mm"].to_list() == [0.0, 72.0, 72.0, 1.0, 1.0, 1.0]
    with pytest.raises(ProgramError, match=r"the program moves on after G\d\d in line 6"):
        read(text)


# Parameters of the control ------------------------------------------------------------------------------------------

SYSTEM = ("#5063", "#5061", "#5399", "#2001", "#3001", "#4001", "#5021", "#1000", "#5221", "#5401", "#<_value_x>")
USES = ("G1 X*", "F*", "S*", "T* M6", "G43 H*", "G10 L2 P1 X*", "G92 X*", "G68 X0 Y0 R*", "M98 P*", "o1 repeat [*]")


@pytest.mark.parametrize("use", USES)
@pytest.mark.parametrize("number", SYSTEM[:-1])
def test_a_value_of_the_control_is_carried_until_it_is_used(number: str, use: str) -> None:
    if number == "#5399":
        begin = f"{HEAD}M66 P1 L0\n#100={number}\n#<depth>=[#100 * 2 + 1]\n"
    else:
        begin = f"{HEAD}(probe)\n#100={number}\n#<depth>=[#100 * 2 + 1]\n"
    assert len(read(begin + "G1 X3\nM2\n").motions) == 2
    with pytest.raises(ProgramError) as caught:
        end = "\no1 endrepeat" if "repeat" in use else ""
        read(f"{begin}{use.replace('*', '#<depth>')}{end}\nM2\n")
    assert str(caught.value.where).startswith("part.nc:8:")
    assert f"part.nc:{5 if number == '#5399' else 6}" in str(caught.value)
    assert caught.value.hint


@pytest.mark.parametrize("flow", ["o1 if [#100 GT 0]\nG1 X5\no1 endif", "o1 while [#100 GT 0]\n#100=0\no1 endwhile"])
def test_a_condition_that_is_not_known_is_refused(flow: str) -> None:
    with pytest.raises(
        ProgramError, match=r"6:\d+: a condition is not known: the probe found it \(#5063\) in part.nc:5"
    ):
        read(f"{HEAD}#100=#5063\n{flow}\nM2\n")


def test_where_the_tool_stands_is_known_once_its_axes_are_named() -> None:
    assert ends(read(HEAD + "G1 X[#5420 + 2] Y#<_z>\nM2\n"))[-1] == [2, 5, 5]
    with pytest.raises(ProgramError, match="where the tool stands"):
        read("G21 G90\nG0 X[#5420 + 2]\nM2\n")


# Macros and subprograms ---------------------------------------------------------------------------------------------


def test_a_macro_gets_the_letters_of_its_call() -> None:
    macro = "O9010\n#30=#24\nG1 X#30 Y#25 F#9\nM99\n"
    program = read(f"{HEAD}#24=99\nG65 P9010 X5. Y[1+1] F300\nG1 X#24\nM30\n{macro}")
    assert ends(program)[1:] == [[5, 2, 5], [99, 2, 5]]
    assert program.motions[1].feed_m_s == pytest.approx(5e-3)
    with pytest.raises(ProgramError, match="the parameter has never been given a value; got #25"):
        read(f"{HEAD}G65 P9010 X5. F300\nM30\n{macro}")


@pytest.mark.parametrize(
    ("call", "times"), [("M98 P3", 1), ("M98 P3 L2", 2), ("M98 P30003", 3), ("M98 P20003", 2), ("M97 P70 L2", 2)]
)
def test_subprograms_run_as_often_as_the_call_says(call: str, times: int) -> None:
    program = read(f"{HEAD}{call}\nM30\nO3\nN70 G91 G1 X1\nG90\nM99\n")
    assert ends(program)[-1] == [times, 0, 5]


@pytest.mark.parametrize("name", ["O1001.nc", "1001.nc", "O1001", "1001.ngc", "o1001.NC"])
def test_a_subprogram_is_a_file_of_the_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("%\nO1001\nG1 X7\nM99\n%\n")
    (tmp_path / "main.nc").write_text(f"%\nO1\n{HEAD}M98 P1001\nM30\n%\n")
    program = read_gcode_file(tmp_path / "main.nc", machine=MillingMachine(known=False))
    assert ends(program)[-1] == [7, 0, 5]
    assert not program.straight


@pytest.mark.parametrize("text", ["{}%\n", "%\n{}%\n", "%\nO0001(PART)\n{}%\n\n", "{}%"])
def test_a_percent_sign_alone_ends_a_program(text: str) -> None:
    program = read_gcode(text.format(HEAD), complete=True)
    assert len(program.motions) == 1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.integers(-50, 50)] * 3), min_size=2, max_size=6), st.sampled_from(OFFSETS))
def test_the_name_of_the_only_offset_does_not_matter(points: list[tuple[int, int, int]], offset: str) -> None:
    lines = [f"G{index % 2} X{x} Y{y} Z{z} F600" for index, (x, y, z) in enumerate(points)]
    program = read("\n".join(["G21 G90", offset, *lines, "M2"]))
    assert np.array(ends(program)) == pytest.approx(np.array(points, dtype=float))


def test_offsets_of_other_languages_in_the_cell_file_are_left_alone() -> None:
    assert read(HEAD + "M2\n", part_offsets={"G54": (0.0, 0.0, 0.0), "G505": (1.0, 0.0, 0.0)}).part_zero is None
    with pytest.raises(InputError, match="unknown work offset"):
        read_gcode("M2", machine=MillingMachine(work_offsets={"G505": (0.0, 0.0, 0.0)}))


LOOP = "#1=0\nWHILE [#1 LT 3] DO1\nG1 X#1\n#1=#1+1\nEND1\n"


@pytest.mark.parametrize(
    ("text", "last"),
    [
        (LOOP, [2, 0, 5]),
        (LOOP.replace(" ", "").replace("WHILE", "N20WHILE"), [2, 0, 5]),
        ("IF [1 GT 0] GOTO 30\nG1 X9\nN30 G1 Y4\n", [0, 4, 5]),
        ("IF [1 LT 0] GOTO 30\nG1 X9\nN30 G1 Y4\n", [9, 4, 5]),
        ("GOTO 30\nG1 X9\nN30 G1 Y4\n", [0, 4, 5]),
        ("#2=1\nIF [#2 EQ 1] THEN #3=6\nG1 X#3\n", [6, 0, 5]),
        ("#2=1\n#3=2+#2*3\nIF [#2 NE 1] THEN #3=6\nG1 X#3\n", [5, 0, 5]),
        ("#1=1\nN10 G91 G1 X1\nG90\n#1=#1+1\nIF [#1 LT 5] GOTO 10\n", [4, 0, 5]),
        ("#1=0\nDO2\nG1 X#1\nIF [#1 GE 2] GOTO 7\n#1=#1+1\nEND2\nN7\n", [2, 0, 5]),
        ("IF [#7 EQ #0] GOTO 3\nG1 X9\nN3\n", [0, 0, 5]),
        ("POPEN\nDPRNT[X#1[53]]\nPCLOS\nG1 X9\n", [9, 0, 5]),
    ],
)
def test_jumps_and_loops_of_fanuc_macros(text: str, last: list[int]) -> None:
    assert ends(read(f"{HEAD}{text}M30\n"))[-1] == last


@pytest.mark.long
def test_loops_beside_values_that_are_not_known() -> None:
    loop = "#100=#5063\n#1=0\no1 while [#1 LT 20]\n#1=[#1 + 1]\no1 endwhile\nG1 X#1\n"
    assert ends(read(f"{HEAD}{loop}M2\n"))[-1] == [20, 0, 5]
    for endless in ("o1 while [1]\no1 endwhile", "N5 GOTO 5", "#1=0\nN5 #1=[#1 + 1]\nGOTO 5"):
        with pytest.raises(ProgramError, match="the program (never ends|does not end)"):
            read(f"{HEAD}#100=#5063\n{endless}\nM2\n")


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("GOTO 99", "a jump to a block that is not there; got N99"),
        ("IF [#5063 GT 0] GOTO 10", "a condition is not known: the probe found it"),
        ("IF [#500 EQ #0] GOTO 10", "a condition is not known: the control keeps it .#500."),
        ("WHILE [1 GT 0] DO1", "DO1 is never closed"),
        ("END1", "END1 closes no loop"),
        ("IF [1 GT 0] G0", "GOTO or THEN is expected"),
        ("WHILE [1 GT 0] DO4", "the number of a loop is 1, 2 or 3"),
        ("G66 P9010", "the modal call of a macro G66"),
    ],
)
def test_flow_of_macros_that_is_wrong_or_not_known(line: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match):
        read(f"{HEAD}{line}\nM30\n")


@pytest.mark.parametrize(
    "text",
    [
        "M97 P70 L2\nM30\nN70 G91 G1 X1\nG90\nM99\n",
        "G65 P9010 X5. Y2. L2\nM30\nO9010\nG1 X#24 Y#25\nG1 X0\nM99\n",
        f"{LOOP}M30\n",
        "G54\nG68 X0 Y0 R30\nM98 P3 L2\nG69\nM30\nO3\nG0 X1 Y0\nG1 X5\nM99\n",
    ],
)
def test_macros_and_loops_are_written_out_as_they_run(text: str) -> None:
    program = read(HEAD + text)
    path = tool_path(program, step_m=1e-3)
    shift = np.where((path.feed_m_s > 0.0)[:, None], [0.0, 0.2 * MM, 0.0], 0.0)
    written = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False)
    assert written.unrolled
    again = read(written.text)
    feeds = [np.round(motion.p_end / MM, 3).tolist() for motion in again.motions if motion.kind == "feed"]
    for motion in program.motions:
        if motion.kind == "feed":
            assert np.round(motion.p_end / MM + [0.0, 0.2, 0.0], 3).tolist() in feeds
    assert not {"M97", "G65", "WHILE", "M98"} & set(written.text.split())


@pytest.mark.parametrize(("line", "reason"), [
    ("#2501=100", "work offset of Fanuc"), ("#2001=0.5", "tool or work offset"),
    ("IF [1 GT 0] THEN #3000=1", "alarm"), ("#3000=1(TOOL BROKEN)", "alarm"),
])  # fmt: skip
def test_what_an_assignment_does_on_the_control_is_not_passed_over(line: str, reason: str) -> None:
    with pytest.raises(ProgramError, match=reason):
        read_gcode(f"G21 G90 G54 G0 X0 Y0 Z5\n{line}\nG1 X1 F100\nM30\n")


def test_an_alarm_behind_a_condition_that_does_not_hold_stops_nothing() -> None:
    text = "G21 G90 G54 G0 X0 Y0 Z5\n#100=1\nIF [#100 LT 0] THEN #3000=1\nG1 X1 F100\nM30\n"
    assert len(read_gcode(text).motions) == 2
