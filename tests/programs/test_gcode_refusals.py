"""What the reader refuses: every case ends in one line with name, line, column and the offending value."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.errors import InputError, ProgramError
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode, read_gcode_file
from counterflex.programs.reading import read_program_file

HEAD = "G21 G90 F100\n"
CASES = {
    "unknown letter": ("G0 X1 U2", "2:7: axes U V W are not read; got U2"),
    "unknown G": ("G0.5 X1", "2:1: an unknown G code; got G0.5"),
    "unknown M": ("M123", "2:1: an unknown M code; got M123"),
    "Sinumerik assignment": ("G0 Z=50", "2:5: a number is expected; got '=50'"),
    "Sinumerik arc": ("G2 X20 Y0 CR=10", "2: this is Sinumerik; G-code as LinuxCNC reads it is required; got G2"),
    "Sinumerik word": ("TRAORI", "2: this is Sinumerik; G-code as LinuxCNC reads it is required; got TRAORI"),
    "repeated axis": ("G0 X1 Y2 X3", "2:10: the word appears twice in one block; got X3"),
    "two motions": ("G0 G1 X1", "2:4: two codes of the modal group 'motion' in one block; got G0 and G1"),
    "two planes": ("G17 G18", "2:5: two codes of the modal group 'plane'"),
    "two spindle codes": ("M3 M5", "2:4: two codes of the modal group 'spindle' in one block; got M3 and M5"),
    "no motion code": ("X5", "2:1: an axis word, but no motion code is active; got X5"),
    "G80 moves": ("G80 X5", "2:1: G80 moves nothing, yet there are axis words"),
    "no number": ("G1 X", "2:5: a number is expected; got nothing"),
    "sign only": ("G1 X-", "2:5: a number is expected; got '-'"),
    "two points": ("G1 X1.2.3", "2:5: a number is expected; got '1.2.3'"),
    "exponent": ("G1 X1e3", "2:6: nothing in this block uses the word E; got E3"),
    "comma": ("G1 X1,5", "2:6: a decimal comma; got ',5'"),
    "not ASCII": ("G1 X1 \u00d75", "2:7: a character that G-code does not know; got '\u00d7'"),
    "unused R": ("G0 X5 R3", "2:7: nothing in this block uses the word R; got R3"),
    "unused P": ("G1 X5 P3", "2:7: nothing in this block uses the word P; got P3"),
    "negative feed": ("F-3", "2:1: the feed F is out of range; got F-3"),
    "negative speed": ("S-3", "2:1: the spindle speed S is out of range; got S-3"),
    "fractional tool": ("T1.5 M6", "2:1: T needs a whole number from 0 to 99999; got T1.5"),
    "change to no tool": ("M6", "2:1: M6 changes to a tool that no T word has chosen"),
    "zero feed": ("F0 G1 X1", "2:1: a feed move without a feed; got F0"),
    "inverse time without F": ("G93 G1 X1", "2:1: inverse time (G93) needs F in every block that feeds; got no F"),
    "revolution feed, no spindle": ("G95 F.1 G1 X1", "2:5: feed per revolution (G95) with the spindle stopped"),
    "dwell without time": ("G4", "2:1: a dwell needs its time P"),
    "negative dwell": ("G4 P-1", "2:4: a dwell needs its time P in seconds, 0 to 1e6; got P-1"),
    "arc without centre": ("G2 X10", "2:1: an arc has neither R nor a centre; got G2"),
    "arc without words": ("G2", "2:1: the motion code has no axis word; got G2"),
    "arc radii": ("G2 X10 Y1 I4", "2:11: the arc's radius at its end differs from that at its start; got 4 at"),
    "arc zero radius": ("G2 X0 Y0 I0", "2:10: the arc has no radius; got 0 and 0"),
    "arc both": ("G2 X10 I5 R5", "2:11: an arc has both R and a centre; got R5"),
    "arc R too small": ("G2 X10 R3", "2:8: the arc's R is too small to reach the end point; got R3 for a chord of 10"),
    "arc R circle": ("G2 X0 Y0 R3", "2:10: an arc with R must end elsewhere than it starts"),
    "arc wrong plane": ("G18 G2 X10 I5 J1", "2:15: J has no place in an arc of plane G18; got J1"),
    "arc turns": ("G2 X10 I5 P0", "2:11: P needs a whole number from 1 to 100000; got P0"),
    "absolute centre": ("G90.1 G2 X10 I5", "under G90.1 an arc needs both words of its centre"),
    "radius compensation": ("G41 D1", "2:1: cutter radius compensation G41 depends on the machine's tool table"),
    "radius compensation right": ("G42 D1", "2:1: cutter radius compensation G42"),
    "threading": ("G76 P1 Z-1", "2:1: threading cycle G76 is not milling"),
    "tapping": ("G84 Z-1 R1", "2:1: tapping G84 is not milling"),
    "probing": ("G38.2 Z-5", "2:1: probing G38.2 has no known end point"),
    "spline": ("G5 X1 Y1 P1 Q1", "2:1: splines G5 are not read"),
    "cycle without Z": ("G81 X1 R2", "2:1: G81 needs the word Z"),
    "cycle without R": ("G81 X1 Z-2", "2:1: G81 needs the word R"),
    "peck without Q": ("G83 X1 Z-2 R2", "2:1: G83 needs the word Q"),
    "peck of zero": ("G83 X1 Z-2 R2 Q0", "2:15: the peck Q of G83 is not positive; got Q0"),
    "endless pecks": ("G83 X1 Z-900 R2 Q.0001", "2:17: the peck Q of G83 makes too many pecks; got Q0.0001"),
    "R below Z": ("G81 X1 Z3 R2", "2:11: the R height of G81 is below the bottom of the hole; got R at 2, bottom at 3"),
    "cycle, zero repeats": ("G81 X1 Z-1 R2 L0", "2:15: L needs a whole number from 1 to 10000; got L0"),
    "offset number": ("G10 L2 P12 X1", "2:8: P needs a whole number from 0 to 9; got P12"),
    "offset kind": ("G10 L1 P1 Z1", "2:5: G10 is read with L2 or L20 only; got L1"),
    "offset rotated": ("G10 L2 P1 R30", "2:11: a rotated work offset (G10 ... R) is not read; got R30"),
    "G92 without axes": ("G92", "2:1: G92 needs an axis word"),
    "G92 and G1": ("G92 G1 X5", "2:1: two codes of one block both need the axis words; got G92 and G1"),
    "G53 with arc": ("G53 G2 X10 I5", "2:1: G53 goes with G0 or G1 only; got G2"),
    "G53 incremental": ("G91 G53 G0 X10", "2:5: G53 under G91 is not defined"),
    "unit and feed": ("G20 F10", "2:5: F stands in the block that changes the unit"),
    "beyond any machine": ("G0 X9999999", "2:4: the target is beyond any machine; got X1e+07"),
    "comment open": ("G0 X1 (move", "2:7: the comment is not closed; got '(move'"),
    "comment nested": ("G0 (a (b) c) X1", "2:7: a comment opens inside a comment"),
    "slash inside": ("G0 /X1", "2:4: a letter is expected; got '/'"),
    "percent inside": ("%", "2:1: a % in a program that does not begin with one; got %"),
    "division": ("G0 X[1/0]", "2:7: division by zero; got 1 / 0"),
    "root": ("G0 X[SQRT[-1]]", "2:6: SQRT has no value for this argument; got -1"),
    "overflow": ("G0 X[EXP[9999]]", "2:6: EXP has no value for this argument; got 9999"),
    "power": ("G0 X[[0-2] ** .5]", "2:12: ** has no value for these numbers; got -2 and 0.5"),
    "open bracket": ("G0 X[1 + 2", "2:11: an operator or ] is expected; got the end of the line"),
    "empty bracket": ("G0 X[]", "2:6: a number is expected; got ']'"),
    "unknown function": ("G0 X[SINH[1]]", "2:6: an unknown function or a missing number; got 'sinh[1]]'"),
    "half ATAN": ("G0 X[ATAN[1]]", "2:13: ATAN needs two brackets; got ']'"),
    "unset number": ("G0 X#7", "2:5: the parameter has never been given a value; got #7"),
    "unset name": ("G0 X#<depth>", "2:5: the parameter has never been given a value; got #<depth>"),
    "no such parameter": ("G0 X#9999", "2:5: no such parameter; got #9999"),
    "system parameter": ("#5221 = 3", "2:1: the parameter belongs to the machine; got #5221"),
    "assignment without value": ("#3", "2:3: = is expected after a parameter; got 'end of line'"),
    "endless loop": ("o1 while [1]\no1 endwhile", "2:1: the program never ends: this line is reached again"),
    "long loop": (
        "#1=0\no1 while [#1 lt 9999]\n#1=[#1+1]\no1 endwhile",
        "the program does not end within the step limit; got 1000 lines",
    ),
    "endless M99": ("M99", "2:1: M99 outside a subprogram runs the program for ever"),
    "endless recursion": ("o1 sub\no1 call\no1 endsub\no1 call", "3:1: subroutines call each other too deeply"),
    "missing sub": ("o<drill> call [1]", "2:1: the subroutine is not defined; got Odrill"),
    "missing M98": ("M98 P77", "the subroutine is not defined; got O77"),
    "open if": ("o1 if [1]", "2:1: O1 if is never closed; got o1 if [1]"),
    "crossed": ("o1 if [1]\no2 repeat [2]\no1 endif", "4:1: O1 endif closes nothing of its own; got O2 repeat"),
    "unknown O word": ("o1 until [1]", "2:4: an unknown O word; got 'until[1]'"),
    "break outside": ("o1 break", "2:1: break stands in no loop of its label; got O1"),
    "else twice": ("o1 if [1]\no1 else\no1 else\no1 endif", "4:1: O1 else follows its else"),
    "defined twice": ("o1 sub\no1 endsub\no1 sub\no1 endsub", "4:1: the subroutine is defined twice; got O1"),
    "too long": ("G1 " + " ".join(f"#{n}=1" for n in range(1, 90)), "2:"),
    "G96 without limit": ("G96 S100", "2:1: G96 needs a speed limit D above 0"),
    "negative tolerance": ("G64 P-1", "2:5: a path tolerance is negative; got P-1"),
    "M66 used": (
        "M66 P1 L0\nG1 X#5399", "3:4: X is not known: an input signal decides about it (M66) in part.ngc:2. Write",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), CASES.values(), ids=CASES.keys())
def test_refusal_names_place_and_value(text: str, message: str) -> None:
    with pytest.raises(ProgramError) as caught:
        read_gcode(HEAD + text + "\nM2\n", name="part.ngc", step_limit=1000)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("part.ngc:")
    assert message in line


@pytest.mark.parametrize("plain", [True, False])
def test_no_feed_at_all(plain: bool) -> None:
    with pytest.raises(ProgramError, match=r"part:1:1: a feed move without a feed; got no F"):
        read_gcode("G1 X5", name="part", plain_lines=plain)


@pytest.mark.parametrize("text", ["", "\n\n", "  \t\n"])
def test_empty_text(text: str) -> None:
    with pytest.raises(ProgramError, match=r"part:1:1: the program is empty\. Give a file with G-code; post it again"):
        read_gcode(text, name="part")


def test_unknown_dialect() -> None:
    with pytest.raises(InputError, match="language"):
        read_program_file("part.ngc", dialect="okuma")


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"machine": MillingMachine(tool_lengths={1: 99.0})}, "length of tool 1"),
        ({"machine": MillingMachine(work_offsets={"G60": (0.0, 0.0, 0.0)})}, "unknown work offset"),
        ({"machine": MillingMachine(work_offsets={"G54": (0.0, 0.0)})}, "three or six"),
        ({"machine": MillingMachine(work_offsets={"G54": (0.0, 0.0, float("nan"))})}, "three or six"),
        ({"machine": MillingMachine(parameters={9000: 1.0})}, "no name of a parameter"),
        ({"machine": MillingMachine(parameters={"_a": float("nan")})}, "no finite value"),
        ({"step_limit": 0}, "step limit"),
    ],
)
def test_arguments_out_of_range(given: dict[str, object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        read_gcode("M2", **given)  # type: ignore[arg-type]


def test_file_that_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "cut.ngc"
    path.write_text("G21 G0 X1\nG1 X5 F100\n", encoding="ascii")
    with pytest.raises(ProgramError, match=r"cut\.ngc:2:1: the program stops without M2, M30 or a closing %"):
        read_gcode_file(path)
    assert len(read_gcode_file(path, complete=False).motions) == 2


def test_files_that_are_no_programs(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="no such file|it is a folder"):
        read_gcode_file(tmp_path / "missing.ngc")
    with pytest.raises(ProgramError, match="no such file|it is a folder"):
        read_gcode_file(tmp_path)
    binary = tmp_path / "binary.ngc"
    binary.write_bytes(b"G0\0X1")
    with pytest.raises(ProgramError, match="not a text file"):
        read_gcode_file(binary)
