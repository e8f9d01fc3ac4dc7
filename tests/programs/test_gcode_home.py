"""G28, G30 and G53: places of a machine that nobody knows, and the parameter file that says where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError, ProgramError
from counterflex.core.units import MM
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine, read_parameter_file
from counterflex.programs.gcode.read.reader import read_gcode, read_gcode_file
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.program import Program

CUT = "G21 G17 G90\nM3 S9000\nG0 X0 Y0 Z5\nG1 Z-1 F300\nG1 X40 F900\nG0 Z5\n"
ENDS = {
    "as Fusion posts": "M5\nG28 G91 Z0.\nG90\nG28 G91 X0. Y0.\nG90\nM30\n",
    "all axes": "G28\nM30\n",
    "second place": "G91 G30 Z0\nM30\n",
    "over a height": "G90 G28 Z20\nM2\n",
    "twice": "G91 G28 Z0\nG91 G28 X0 Y0\nG30\nG90\nM2\n",
    "then nothing but M-codes": "G91 G28 Z0\nM5 M9\nG4 P1\nM2\n",
}
VAR = (
    "5161\t10.0\n5162\t20.0\n5163\t150.0\n5181\t0\n5182\t0\n5183\t90\n"
    "5220\t1\n5221\t100\n5222\t200\n5223\t50\n5241\t110\n5242 200\n5243 50\n"
)


def read(text: str, *, machine_known: bool = False) -> Program:
    return read_gcode(text, name="part.ngc", machine=MillingMachine(known=machine_known))


@pytest.mark.parametrize("end", sorted(ENDS))
def test_the_way_home_after_the_last_cut_is_taken_as_it_is(end: str) -> None:
    program = read(CUT + ENDS[end])
    whole = read(CUT + "M2\n")
    assert len(program.motions) - len(whole.motions) <= 2  # the point on the way, a dwell
    if end != "over a height":
        assert program.motions[-1].p_end == pytest.approx([0.04, 0.0, 0.005])
    result = write_gcode(program, CompensatedPath.nominal(tool_path(program)))
    assert result.text == CUT + ENDS[end]


def test_the_line_stays_behind_a_corrected_end() -> None:
    text = CUT.removesuffix("G0 Z5\n") + "G91 G28 Z0\nG90\nM30\n"
    program = read(text)
    path = tool_path(program, step_m=1e-3)
    shift = np.where((path.motion == len(program.motions) - 1)[:, None], [0.0, 0.2 * MM, 0.0], 0.0)
    lines = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text.splitlines()
    assert lines[-3:] == ["G91 G28 Z0", "G90", "M30"]
    assert any("Y0.2000" in line for line in lines)


@pytest.mark.parametrize("start", ["G28 G91 Z0.\nG90\n", "G53 G0 Z0\n", "G30\n", "G91 G28 Z0\nG28 X0 Y0\nG90\n"])
def test_before_the_first_motion_no_place_is_known_anyway(start: str) -> None:
    plain = read(CUT + "M2\n")
    found = read(CUT.replace("M3", start + "M3") + "M2\n")
    assert [motion.p_end.tolist() for motion in found.motions] == [motion.p_end.tolist() for motion in plain.motions]


@pytest.mark.parametrize("home", ["G91 G28 Z0", "G28", "G30", "G53 G0 Z0", "G91 G28 X0 Y0"])
@pytest.mark.parametrize(
    "onward", ["G90 G0 X0", "G90 G1 X0", "G90 G0 Z5", "G91 X5", "G90 G2 X0 I-20", "G90 G81 X0 Z-1 R2"]
)
def test_nothing_may_follow_a_place_that_is_not_known(home: str, onward: str) -> None:
    """The robot would go there from where it has stayed, low over the part."""
    with pytest.raises(ProgramError, match=r"moves on after G\d\d in line 7, .*--parameters FILE") as caught:
        read(f"{CUT}{home}\n{onward}\nM2\n")
    assert str(caught.value.where).startswith("part.ngc:8")


def test_where_machine_coordinates_are_known_g53_leads_there() -> None:
    assert read(CUT + "G53 G0 Z30\nG0 X0\nM2\n", machine_known=True).motions[-1].p_end[2] == pytest.approx(0.030)


# The parameter file -------------------------------------------------------------------------------------------------


def with_file(folder: Path, text: str, parameters: str = VAR) -> Program:
    (folder / "machine.var").write_text(parameters, encoding="ascii")
    (folder / "part.ngc").write_text(text, encoding="ascii")
    machine = read_parameter_file(folder / "machine.var")
    return read_gcode_file(folder / "part.ngc", machine=machine)


def test_places_of_the_machine_are_seen_from_g54(tmp_path: Path) -> None:
    """Stored X10 Y20 Z150 with the part at X100 Y200 Z50 of the machine."""
    program = with_file(tmp_path, CUT + "G91 G28 Z0\nG90\nG28 X0 Y0 Z60\nG30\nG53 G0 Z55\nG55 G0 X0 Y0 Z70\nM2\n")
    ends = [tuple(np.round(motion.p_end / MM, 6).tolist()) for motion in program.motions]
    assert ends[:4] == [(0, 0, 5), (0, 0, -1), (40, 0, -1), (40, 0, 5)]
    assert (40, 0, 100) in ends  # G28 Z: 150 - 50
    assert (-90, -180, 100) in ends  # G28 of all axes
    assert (-100, -200, 40) in ends  # G30
    assert ends[-2] == (-100, -200, 5)  # G53 Z55
    assert ends[-1] == (10, 0, 70)  # G55 lies 10 mm beside G54


def test_without_home_nothing_changes_with_the_file(tmp_path: Path) -> None:
    text = CUT + "G2 X30 I-5\nM2\n"
    plain, found = read(text), with_file(tmp_path, text)
    for one, other in zip(plain.motions, found.motions, strict=True):
        assert one.p_end == pytest.approx(other.p_end, abs=1e-12)
        assert one.p_start == pytest.approx(other.p_start, abs=1e-12)
        assert (one.p_centre is None) == (other.p_centre is None)
        if one.p_centre is not None:
            assert one.p_centre == pytest.approx(other.p_centre, abs=1e-12)
    for block, same in zip(plain.blocks, found.blocks, strict=True):
        assert block.modal.p_part_origin == pytest.approx(same.modal.p_part_origin, abs=1e-12)


def test_a_corrected_program_is_written_in_words_of_its_own_offset(tmp_path: Path) -> None:
    program = with_file(tmp_path, CUT + "G91 G28 Z0\nM2\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.where(((path.motion == 2) & (path.feed_m_s > 0.0))[:, None], [0.0, 0.2 * MM, 0.0], 0.0)
    text = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text
    assert "G1 X40.0000 Y0.2000" in text or "Y0.2000" in text
    assert "Y200" not in text


def test_parameters_of_the_file_can_be_read_by_the_program(tmp_path: Path) -> None:
    program = with_file(tmp_path, CUT + "G0 X#5223 Z#31\nM2\n", VAR + "31 12.5\n")
    assert program.motions[-1].p_end == pytest.approx([0.05, 0.0, 0.0125])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("5161 1 2\n", "machine.var:1: no line of a parameter file"),
        ("\n5161 x\n", "machine.var:2: no line of a parameter file"),
        ("9999 1\n", "machine.var:1: no line of a parameter file; got '9999 1'; expected a number from 1 to 5602"),
        ("5161 nan\n", "no line of a parameter file"),
        ("5161 1\n5161 2\n", "machine.var:2: a parameter comes twice; got #5161"),
        ("5230 12\n", "the work offset G54 is rotated; got 12"),
        ("5210 1\n", "an offset by G92 is in force"),
        ("5220 2\n", "another work offset than G54"),
        ("G21\n", "no line of a parameter file"),
    ],
)
def test_what_is_no_parameter_file_is_refused(tmp_path: Path, text: str, match: str) -> None:
    (tmp_path / "machine.var").write_text(text, encoding="ascii")
    with pytest.raises(FileFormatError) as caught:
        read_parameter_file(tmp_path / "machine.var")
    assert match in str(caught.value)


def test_no_file_and_no_text_are_said(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        read_parameter_file(tmp_path / "none.var")
    (tmp_path / "picture.var").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(FileFormatError, match="not plain text"):
        read_parameter_file(tmp_path / "picture.var")


# Programs without an end --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [CUT, "%\n" + CUT, "\n%\nO1000 (PART)\n" + CUT])
def test_without_an_end_a_file_needs_a_word_of_the_user(tmp_path: Path, text: str) -> None:
    (tmp_path / "part.ngc").write_text(text, encoding="ascii")
    with pytest.raises(ProgramError, match="stops without M2, M30 or a closing %.*--without-end"):
        read_gcode_file(tmp_path / "part.ngc")
    found = read_gcode_file(tmp_path / "part.ngc", complete=False)
    assert len(found.motions) == 4
    assert write_gcode(found, CompensatedPath.nominal(tool_path(found))).text == text


def test_between_percent_signs_no_end_is_needed(tmp_path: Path) -> None:
    (tmp_path / "part.ngc").write_text("%\n" + CUT + "%\nremarks of the office\n", encoding="ascii")
    assert len(read_gcode_file(tmp_path / "part.ngc").motions) == 4
