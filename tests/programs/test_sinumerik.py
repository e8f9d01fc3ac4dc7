"""The Sinumerik dialect: read beside LinuxCNC's reader where the words agree, written back with targets replaced."""

from __future__ import annotations

import importlib.util
import itertools
import math
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.app import examples
from counterflex.app.compensation.robot_program import omissions
from counterflex.app.inputs import machine_of, read_job
from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import INCH, MM, MM_PER_MIN
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import rotation
from counterflex.integrations.siemens.language.reader import read_sinumerik
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Program
from counterflex.programs.reading import dialect_of, read_program_file, require_linuxcnc
from counterflex.programs.rotary.fitted import fitted
from counterflex.programs.rotary.poses import RotaryWords, turned_path
from counterflex.programs.stated.two_readings import doubtful_readings

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "tests" / "data" / "gcode" / "corpus"
EXAMPLES = ROOT / "examples" / "programs"
TOLERANCE = 5e-6
ROUNDING = 1e-7 * 0.87 + 1e-9
AGREEING = ("straight", "arcs_centre", "arcs_radius", "helices", "planes", "feeds")
"""Programs that test_gcode_rs274.py holds to LinuxCNC's own interpreter, made of words that Sinumerik has too."""


def rs274() -> ModuleType:
    spec = importlib.util.spec_from_file_location("against_rs274", Path(__file__).with_name("test_gcode_rs274.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


RS274 = rs274()


def translated(text: str) -> str:
    """A LinuxCNC program in the words of Sinumerik."""
    lines, centre_absolute = [], False
    for line in text.splitlines():
        line = re.sub(r"\(([^)]*)\)", r"; \1", line)
        centre_absolute = (centre_absolute or "G90.1" in line) and "G91.1" not in line
        line = re.sub(r"G90\.1|G91\.1|G49|G80", "", line)
        line = line.replace("G20", "G700").replace("G21", "G710")
        if "G4 " in line:
            line = re.sub(r"P([\d.]+)", r"F\1", line)
        else:
            line = re.sub(r"P(\d+)", lambda match: f" TURN={int(match[1]) - 1}", line)
        line = re.sub(r"(?<![A-Z])R(-?[\d.]+)", r" CR=\1", line)
        if centre_absolute:
            line = re.sub(r"([IJK])(-?[\d.]+)", r"\1=AC(\2) ", line)
        lines.append(line)
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", AGREEING)
def test_words_that_agree_mean_what_they_mean_to_linuxcnc(name: str) -> None:
    text = (CORPUS / f"{name}.ngc").read_text(encoding="ascii")
    reference, ours = read_gcode(text), read_sinumerik(translated(text), complete=True)
    assert len(ours.motions) == len(reference.motions) >= 5
    for motion, truth in zip(ours.motions, reference.motions, strict=True):
        where = ours.blocks[motion.block].text
        assert motion.kind == truth.kind, where
        assert motion.p_end == pytest.approx(truth.p_end, abs=1e-12), where
        assert motion.turn_rad == pytest.approx(truth.turn_rad, abs=1e-9), where
        assert motion.feed_m_s == pytest.approx(truth.feed_m_s, rel=1e-12), where
        assert motion.duration_s == truth.duration_s
        assert motion.spindle_rad_s == pytest.approx(truth.spindle_rad_s)
        if truth.p_centre is not None:
            assert motion.p_centre == pytest.approx(truth.p_centre, abs=1e-12), where
            assert motion.normal == pytest.approx(truth.normal, abs=0.0)


@pytest.mark.parametrize("name", AGREEING)
def test_words_that_agree_against_the_calls_of_linuxcnc_itself(name: str) -> None:
    """The same against the golden files that LinuxCNC's interpreter wrote, without our reader between."""
    calls = (CORPUS / f"{name}.canon").read_text(encoding="ascii").splitlines()
    text = (CORPUS / f"{name}.ngc").read_text(encoding="ascii")
    RS274.compare(read_sinumerik(translated(text)), RS274.canonical_motions(calls))


def test_the_groove_is_the_same_path_in_both_dialects() -> None:
    ours = read_program_file(EXAMPLES / "groove.mpf")
    reference = read_program_file(EXAMPLES / "groove.ngc")
    assert (ours.dialect, reference.dialect) == ("sinumerik", "linuxcnc")
    one, other = tool_path(ours), tool_path(reference)
    assert one.p_part_tcp == pytest.approx(other.p_part_tcp, abs=1e-9)
    assert one.time_s == pytest.approx(other.time_s, abs=1e-9)


def test_the_tilted_groove_is_the_same_path_with_tool_vectors_and_with_rotary_words() -> None:
    cell = read_cell(ROOT / "examples" / "cells" / "kr300_bc_table.toml")
    rows = []
    for ending in ("mpf", "ngc"):
        program = fitted(read_program_file(EXAMPLES / f"tilted_groove.{ending}"), machine_of(cell))
        words = RotaryWords.of(program, machine_of(cell))
        path = turned_path(program, words, step_m=1e-3, rapid_speed_m_s=0.5).path
        first = int(np.argmax(path.kind == FEED))
        rows.append(np.hstack([path.p_part_tcp, path.axis_part, path.feed_m_s[:, None]])[first:])
    assert len(rows[0]) > 90
    assert rows[0] == pytest.approx(rows[1], abs=1e-9)


def ends(text: str) -> list[list[float]]:
    program = read_sinumerik("G90 G0 X0 Y0 Z0\n" + text)
    return [[round(float(x) / MM, 9) + 0.0 for x in motion.p_end] for motion in program.motions[1:]]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G0 X=10.5 Y=-2EX1", [[10.5, -20, 0]]),
        ("G0 X10 Y10\nG91 X1 Y=AC(3)\nX=IC(2)\nG90 X=IC(2) Y5", [[10, 10, 0], [11, 3, 0], [13, 3, 0], [15, 5, 0]]),
        ("TRANS X10 Z5\nG0 X1\nATRANS X2 Y3\nY0\nTRANS\nX1 Y1 Z1", [[11, 0, 0], [11, 3, 0], [1, 1, 1]]),
        ("ROT RPL=90\nG0 X10\nY2\nROT\nX1 Y1", [[0, 10, 0], [-2, 10, 0], [1, 1, 0]]),
        ("TRANS X10\nAROT Z90\nATRANS X5\nG0 X1 Y0 Z0", [[10, 6, 0]]),
        ("ROT X90\nAROT Z90\nG0 X1 Y2 Z3", [[-2, -3, 1]]),
        ("G18 ROT RPL=90\nG0 X1 Y2 Z3", [[3, 2, -1]]),
        ("G70 G0 X1\nTRANS X1\nX1\nG71 X1", [[25.4, 0, 0], [50.8, 0, 0], [26.4, 0, 0]]),
        ("R1=4.5\nR2=-R1\nG0 X=R1 Y=R2", [[4.5, -4.5, 0]]),
        ("G2 X20 Y0 AR=180 F100", [[20, 0, 0]]),
        ("G3 I10 J0 AR=90 F100", [[10, -10, 0]]),
        ("G3 X=IC(0) Y20 I=AC(0) J=AC(10) F100", [[0, 20, 0]]),
        ("g0x1y2 z=3;comment X9", [[1, 2, 3]]),
    ],
)
def test_targets(text: str, expected: list[list[float]]) -> None:
    assert ends(text) == expected


def test_feed_of_an_inch_program() -> None:
    """G70 leaves F in mm/min, G700 takes it along."""
    one, other = (read_sinumerik(f"{code} G90\nG1 X1 F60") for code in ("G70", "G700"))
    assert [m.feed_m_s for m in one.motions] == pytest.approx([60 * MM_PER_MIN])
    assert [m.feed_m_s for m in other.motions] == pytest.approx([INCH])


def test_a_feed_stays_behind_another_unit() -> None:
    """SINUMERIK 828D, Function Manual, G2: F must be programmed again to count in the new unit."""
    program = read_sinumerik("G700 G90\nG1 X1 F10\nG710 X30\nX40 F10\nG700 X2\nG71 X50\n")
    assert [m.feed_m_s / MM_PER_MIN for m in program.motions] == pytest.approx([254.0, 254.0, 10.0, 10.0, 10.0])


def test_tool_vectors_and_rotary_words() -> None:
    text = "G90 TRAORI\nG0 X0 Y0 Z9 A3=0 B3=0 C3=1\nG1 X5 A3=0.1 C3=1 F900\nX6\nTRAFOOF\nG0 Z50"
    program = read_sinumerik(text)
    assert [b.modal.tool_centre for b in program.blocks] == [TOOL_VECTOR] * 4 + [0, 0]
    assert [m.abc_end for m in program.motions] == [(0, 0, 1), (0.1, 0, 1), (0.1, 0, 1), (0, 0, 0)]
    rotary = read_sinumerik("TRAORI\nG0 X0 Y0 Z9 A0 C0\nG1 X5 A=10 F900")
    assert rotary.blocks[2].modal.tool_centre == TOOL_CENTRE
    assert rotary.motions[1].abc_end == pytest.approx((math.radians(10), 0, 0))
    turned = read_sinumerik("TRAORI\nROT Z90\nG0 X1 Y0 Z0 A3=1 C3=1")
    assert turned.motions[0].abc_end == pytest.approx((0, 1, 1), abs=1e-15)


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("G1 X5 F100 Q3", r"part:2:12: an unknown word of the Sinumerik dialect; got Q3"),
        ("G1 X5 F100 BRISKK", r"part:2:12: an unknown word of the Sinumerik dialect; got BRISKK\. Did you mean BRISK"),
        ("G43 H1", r"part:2:1: an unknown G code of the Sinumerik dialect; got G43"),
        ("M77", "an unknown M code of the Sinumerik dialect; got M77"),
        ("MCALL POCKET3(10,0,2,-5)", "machining cycles are not read: POCKET3"),
        ("CYCLE84(10,0,2,-5)", r"machining cycles are not read: CYCLE84; got CYCLE84\(10,0,2,-5\)"),
        ("CYCLE800(1)", "a swivelled plane, or a retraction"),
        ("SCALE X2", "a scale of the path is not read"),
        ("CT X1 Y1", "the tangential arc CT is not read"),
        ("G41 X5", "cutter radius compensation G41"),
        ("G1 X=R7 F100", "X is not known: nothing in the program gives R7 a value; got X=R7"),
        ("G1 X=(R1+5) F100", "X is not known: nothing in the program gives R1 a value"),
        ("R1=1\nIF R1==1 GOTOF ENDE", "3:16: the label of a jump is not there; got ENDE"),
        ("IF R1==1\nG0 X1\nENDIF", "a condition is not known: nothing in the program gives R1 a value"),
        ("UP_1(5)", "a subprogram is called"),
        ("L100", "a subprogram is called"),
        ("ROT X10 Y20", "turns about several axes"),
        ("TRANS X5 G0", "TRANS needs a block of its own"),
        ("G0 X1\nG55", r"3:1: how far G55 lies from G54 \(line 1\) is not known"),
        ("G1 X5", "a feed move without a feed"),
        ("G2 X5 Y5 F100", "neither a centre nor CR= nor AR="),
        ("G2 X5 Y5 CR=5 I3 F100", "given in two ways"),
        ("G2 X50 CR=5 F100", "R is too small"),
        ("G2 X5 AR=400 F100", "the opening angle AR is out of range"),
        ("A3=1 G0 X1", "without TRAORI"),
        ('T="MILL" M6', "a tool is called by a name that no tool"),
        ("G0 X1 X2", "the word appears twice"),
        ("G0 G1 X1", "two words of the group 'motion'"),
        ("SUPA G0 Z0\nG0 X5", "moves on after SUPA in line 2"),
        ("G1 X=1EX400 F1", "a number is out of range; got 1EX400"),
        ("G4 F-1", "G4 needs its time F"),
        ('MSG("abc', "a bracket is not closed"),
        ("G1 X5 (old comment)", r"a character that has no use here; got '\('"),
    ],
)
def test_refusals_name_word_and_line(line: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match):
        read_sinumerik(f"G54 G90 G0 X0 Y0 Z0\n{line}\nM30\n", name="part")


def test_program_without_end() -> None:
    with pytest.raises(ProgramError, match=r"part:1:1: the program stops without M2, M17, M30 or RET"):
        read_sinumerik("G0 X1\n", name="part", complete=True)


@pytest.mark.parametrize("leaving", ["SUPA G0 Z0 D0", "G0 G153 Z0", "G500\nG0 Z0"])
def test_leaving_for_the_machine_makes_no_motion_and_is_told_to_robots(leaving: str) -> None:
    text = f"G54 G90 {leaving}\nG54\nG0 X1 Y2 Z3\nG1 Z1 F100\n{leaving}\nM17\n".replace("G90 G500", "G90\nG500")
    program = read_sinumerik(text, complete=True)
    assert [m.kind for m in program.motions] == ["rapid", "feed"]
    path = tool_path(program)
    assert write_gcode(program, CompensatedPath.nominal(path)).text == text
    with pytest.raises(ProgramError, match="is the way out of the cut, and where it leads is not known"):
        omissions(program)


def test_the_ending_tells_the_language() -> None:
    names = ("a.mpf", "a.SPF", "a.cls", "a.apt", "a.ngc", "a.nc", "a")
    assert [dialect_of(name) for name in names] == ["sinumerik"] * 2 + ["apt"] * 2 + ["linuxcnc"] * 3
    assert dialect_of("a.nc", "sinumerik") == "sinumerik"
    with pytest.raises(ProgramError, match="plan entry writes G-code as LinuxCNC reads it"):
        require_linuxcnc(read_sinumerik("G0 X1"), "plan entry")


# Writing back ---------------------------------------------------------------------------------------------------------

NUMBER = st.integers(-400, 400).map(lambda n: f"{n / 10:g}")
WORD = st.tuples(st.sampled_from("XYZ"), NUMBER, st.sampled_from(["{}{}", "{}={}", "{}=AC({})", "{}=IC({})"]))
MOVE = st.tuples(
    st.sampled_from(["G1", "G1", "G0", "g1", ""]),
    st.lists(WORD, min_size=1, max_size=3, unique_by=lambda word: word[0]),
    st.sampled_from(["", " F500", " F=800 ; text X1", " M8", " G9"]),
)
ARC = st.tuples(
    st.sampled_from(["G2", "G3"]), st.integers(5, 40), st.sampled_from(["CR={}", "AR=75", "I={} J0", "TURN=1"])
)
OTHER = st.sampled_from(
    ["", "; only text", "MSG(\"a ; b\")", "G64 FFWON", "G91", "G90", "TRANS X5 Y-3", "AROT Z30", "ROT X20", "TRANS",
     "G70", "G71", "G17", "ROT RPL=-15", "G4 F0.5", "S500 M3"]
)  # fmt: skip


def move_text(move: tuple[str, list[tuple[str, str, str]], str]) -> str:
    code, words, more = move
    return " ".join([code, *(shape.format(letter, value) for letter, value, shape in words)]).strip() + more


def arc_text(arc: tuple[str, int, str]) -> str:
    code, size, shape = arc
    if shape.startswith("I="):
        return f"{code} {shape.format(size)}"
    if shape == "TURN=1":
        return f"{code} I{size} TURN=1"
    return f"{code} X=IC({size}) Y=IC(3) {shape.format(2 * size)}"


@st.composite
def programs(draw: st.DrawFn) -> str:
    line = st.one_of(MOVE.map(move_text), MOVE.map(move_text), ARC.map(arc_text), OTHER)
    lines = draw(st.lists(line, min_size=1, max_size=8))
    numbered = draw(st.booleans())
    lines = [f"N{10 * k} {text}" if numbered and text else text for k, text in enumerate(lines, start=1)]
    head = draw(st.sampled_from(["", "%_N_PART_MPF\n;$PATH=/_N_MPF_DIR\n"]))
    return head + "G90 G17 G71\nG0 X0 Y0 Z0\nG1 F600 X1 Y1 Z1\n" + "\n".join([*lines, "M30", "; after the end"]) + "\n"


def corrected(path: ToolPath, size_m: float) -> CompensatedPath:
    p = path.p_part_tcp
    shift = size_m * np.stack([np.sin(30 * p[:, 1] + 1), np.cos(20 * p[:, 0]), np.sin(17 * p[:, 0])], axis=1)
    shift[(path.kind != FEED) | (path.feed_m_s <= 0.0)] = 0.0
    shift[0] = 0.0
    return CompensatedPath.from_correction(path, shift)


def distance(points: Float, polyline: Float) -> float:
    a, d = polyline[:-1], np.diff(polyline, axis=0)
    length2 = np.maximum(np.sum(d * d, axis=1), 1e-30)
    worst = 0.0
    for q in points:
        t = np.clip(np.sum((q - a) * d, axis=1) / length2, 0.0, 1.0)
        worst = max(worst, float(np.sqrt(np.min(np.sum((a + t[:, None] * d - q) ** 2, axis=1)))))
    return worst


TARGET = re.compile(
    r"\b(?:[XYZIJK]|CR|AR|TURN)\s*=?\s*(?:[AI]C\([^)]*\)|[-+.\d]+)|\bF=?[\d.]+|\bG0?[0123]\b", re.IGNORECASE
)


def bare(line: str) -> str:
    """What is left of a line without motion codes, targets and feed."""
    code, mark, text = line.partition(";") if not line.startswith("MSG") else (line, "", "")
    return " ".join(TARGET.sub(" ", code).split()) + mark + text


def read_or_none(text: str) -> Program | None:
    try:
        return read_sinumerik(text, name="p.mpf", complete=True)
    except ProgramError:
        return None  # an arc whose end cannot be reached, a rotated frame at the start: tested above


@settings(max_examples=40, deadline=None)
@given(programs(), st.sampled_from(["\n", "\r\n"]))
def test_what_is_no_target_stays_byte_for_byte(text: str, newline: str) -> None:
    program = read_or_none(text.replace("\n", newline))
    if program is None:
        return
    path = tool_path(program, step_m=2e-3)
    assert write_gcode(program, CompensatedPath.nominal(path)).text == text.replace("\n", newline)
    wanted = corrected(path, 2e-4)
    result = write_gcode(program, wanted, tolerance_m=TOLERANCE, header=False)
    assert result.text.count(newline) == result.text.count("\n")
    source, out = text.splitlines(), result.text.splitlines()
    lines = iter(out)
    for line in source:  # in order: the very line, or the line with other targets
        assert any(bare(line).replace("G9", "").split() == bare(other).replace("G9", "").split() for other in lines), (
            line
        )
    back = read_sinumerik(result.text, name="p.mpf", complete=True)
    rows = np.flatnonzero((path.kind == FEED) & (path.feed_m_s > 0.0))
    unit = 1.0 if "G70" not in text else 2.54
    again = tool_path(back, step_m=2e-3, chord_m=5e-8)
    assert distance(wanted.p_part_command[rows], again.p_part_tcp) <= TOLERANCE + unit * ROUNDING
    last = max(k for k, m in enumerate(path.motion) if program.motions[m].kind != "dwell")  # a dwell stays there
    assert again.p_part_tcp[-1] == pytest.approx(wanted.p_part_command[last], abs=unit * ROUNDING)
    assert sum(m.duration_s for m in back.motions) == pytest.approx(sum(m.duration_s for m in program.motions))


def test_a_rotated_frame_is_written_in_its_own_axes() -> None:
    program = read_sinumerik("G90 G0 X0 Y0 Z0\nROT Z90\nG1 X10 Y0 Z0 F600\nG1 X20 ; end\nROT\nG0 X0 Y0\nM30\n")
    path = tool_path(program, step_m=1.0)
    shift = np.where((path.kind == FEED)[:, None], [1e-4, 2e-4, 0.0], 0.0)
    shift[0] = 0.0
    out = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text.splitlines()
    assert out[:2] == ["G90 G0 X0 Y0 Z0", "ROT Z90"]
    assert out[2].startswith("G1 X10.2000 Y-0.1000 Z0 F")
    assert out[3].startswith("G1 X20.2000")
    assert out[3].endswith(" ; end")
    assert out[4:] == ["ROT", "G0 X0 Y0", "M30"]
    back = read_sinumerik("\n".join(out)).motions[1]
    assert back.p_end == pytest.approx(rotation.exp(np.array([0, 0, math.pi / 2])) @ [0.0102, -1e-4, 0], abs=1e-12)


TOKENS = st.sampled_from(
    ["G0", "G1", "G2", "X", "Y5", "=", "-1.5", "CR=", "AR=", "(", ")", '"', ";", "IC(", "R1", "ROT ", "TRANS", "RPL=",
     "F9",
     "TRAORI", "A3=1", "T=", "1EX400", "%", "/", "é", "\t", " ", "\n", "SUPA", "MSG", "M17"]
)  # fmt: skip


@settings(max_examples=100, deadline=None)
@given(st.lists(TOKENS, max_size=25).map("".join))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        read_sinumerik("G90 G0 X0 Y0 Z0 F5\n" + text)
    except ProgramError as fault:
        assert "\n" not in str(fault)  # noqa: PT017 -- most texts are refused, some are read


def test_a_tool_by_its_name() -> None:
    """The number of the tool of that name in the cell file; capitals do not count, a name that two have is none."""
    cell = read_cell(ROOT / "examples" / "cells" / "kr300_d16_small.toml")
    assert cell.tool_names == {"END MILL D16 Z3": 1, "END MILL D10 Z3": 2}
    text = 'T="End mill D10 z3"\nM6\nG0 X0 Y0 Z5\nT1 M6\nG0 X1\nM30\n'
    program = read_sinumerik(text, machine=MillingMachine(tool_names=cell.tool_names))
    assert [motion.tool for motion in program.motions] == [2, 1]


@pytest.mark.parametrize(("ours", "linuxcnc"), [("CYCLE81(60,40,2,10)", "G81 R42 Z10"),
                                                ("CYCLE82(60,40,2,,30,0.5)", "G82 R42 Z10 P0.5")])  # fmt: skip
@pytest.mark.parametrize("plane", ["G17", "G18"])
def test_drilling_cycles_are_those_of_linuxcnc(ours: str, linuxcnc: str, plane: str) -> None:
    """MCALL behind each position makes the holes that LinuxCNC's reader makes of G81 and G82."""
    first, second, third = {"G17": ("X", "Y", "Z"), "G18": ("Z", "X", "Y")}[plane]
    head = f"{plane} {{}} G90 G94 F300\nG0 {first}10 {second}20\nG0 {third}60\n"
    one = read_sinumerik(
        head.format("G71") + f"MCALL {ours}\n{first}30 {second}5\n{first}40\nMCALL\nG0 {first}0\nM30\n", complete=True
    )
    depth = linuxcnc.replace("Z10", f"{third}10")
    two = read_gcode(head.format("G21 G98") + f"{depth} {first}30 {second}5\n{first}40\nG80\nG0 {first}0\nM30\n")
    moves, truths = (
        [m for m in made.motions if m.kind == "dwell" or np.any(m.p_end != m.p_start)] for made in (one, two)
    )
    assert [m.kind for m in moves] == [m.kind for m in truths]
    for move, truth in zip(moves, truths, strict=True):
        np.testing.assert_allclose(move.p_end, truth.p_end, atol=1e-12)
        assert move.feed_m_s == pytest.approx(truth.feed_m_s)
        assert move.duration_s == truth.duration_s


@settings(max_examples=60, deadline=None)
@given(st.floats(1.0, 30.0), st.floats(0.5, 80.0), st.sampled_from([0.0, 1.0, 3.0, -0.8]), st.sampled_from([0, 1]))
def test_deep_holes_get_deeper_stroke_by_stroke(first: float, more: float, degression: float, removal: int) -> None:
    """Depths fall to the final one, no stroke is below half the degression, rapids stay above the depth reached."""
    bottom = 40.0 - first - more
    call = f"CYCLE83(60,40,2,{bottom:.4f},,{40.0 - first:.4f},,{degression},0,0,0.5,{removal})"
    made = read_sinumerik(f"G17 G71 G90 G94 F300\nG0 X0 Y0 Z60\n{call}\nM30\n", complete=True)
    depth, strokes = 40.0, []
    for motion in made.motions[1:-1]:
        z = float(motion.p_end[2]) / MM
        if motion.kind == "rapid":
            assert z > depth + 0.5
        elif z < depth:
            strokes.append(depth - z)
            depth = z
    assert depth == pytest.approx(bottom, abs=1e-3)
    assert strokes[0] == pytest.approx(first, abs=1e-3)
    if degression > 0.0 and len(strokes) > 2:
        assert min(strokes[1:]) > 0.5 * min(degression, first) - 1e-3
        assert all(b <= a + degression + 1e-3 for a, b in itertools.pairwise(strokes[1:]))
    assert float(made.motions[-1].p_end[2]) == pytest.approx(0.06)
    with pytest.raises(ProgramError, match=r"program:3.*is corrected, and is not written back"):
        path = tool_path(made)
        write_gcode(made, CompensatedPath.from_correction(path, np.full((len(path), 3), 1e-4)))


def test_an_arc_through_a_point_is_that_of_its_centre() -> None:
    """CIP in the plane as G3, absolute and incremental; and one that leaves the plane."""
    head = "G17 G71 G90 G94 F600\nG0 X10 Y0 Z5\n"
    truth = read_sinumerik(head + "G3 X-10 Y0 I-10 J0\nM30\n").motions[-1]
    for line in ("CIP X-10 Y0 I1=0 J1=10", "G91 CIP X-20 Y0 I1=-10 J1=10", "CIP X=-10 I1=AC(0) J1=IC(10)"):
        arc = read_sinumerik(f"{head}{line}\nM30\n").motions[-1]
        assert arc.p_centre == pytest.approx(truth.p_centre, abs=1e-12)
        assert float(arc.normal[2]) * arc.turn_rad == pytest.approx(truth.turn_rad)  # type: ignore[index]
    slanted = read_sinumerik(head + "CIP X-10 Y0 Z5 I1=0 J1=0 K1=15\nM30\n").motions[-1]
    assert slanted.turn_rad == pytest.approx(math.pi)
    np.testing.assert_allclose(np.abs(slanted.normal), [0.0, 1.0, 0.0], atol=1e-12)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("CYCLE81(60,40,2,a)", "no plain number"), ("CYCLE81(,40)", "without RTP and RFP"),
        ("CYCLE81(60,40,2,45)", "needs a depth"), ("CYCLE83(60,40,2,10)", "needs a first depth"),
        ("CYCLE83(60,40,2,10,,30,,5,0,0,1,1,3)", "behind VARI"), ("CYCLE84(60,40,2,10)", "machining cycles"),
        ("CIP X20 Y0 I1=15 J1=0", "lie on a line"), ("G0 Z41\nCYCLE81(60,40,2,10)", "begins below"),
    ],
)  # fmt: skip
def test_cycles_that_are_not_whole_are_refused(line: str, match: str) -> None:
    with pytest.raises(ProgramError, match=rf"program:[34]:\d+.*{match}"):
        read_sinumerik(f"G17 G71 G90 G94 F300\nG0 X0 Y0 Z60\n{line}\nM30\n")


def test_a_program_without_t_is_cut_by_the_only_tool_of_the_cell(tmp_path: Path) -> None:
    """The tool that the operator mounted stays active; with two tools in the cell nobody knows which that is."""
    text = examples.text("cell.toml")
    (tmp_path / "cell.toml").write_text(text)
    (tmp_path / "cut.mpf").write_text("G54 G17 G90 G71\nS13000 M3\nG0 X-12 Y15 Z60\nG1 Z38 F3000\nG1 X10 F1500\nM30\n")
    cell = read_cell(tmp_path / "cell.toml")
    assert len(cell.tables.tools) == 1
    job = read_job(tmp_path / "cut.mpf", cell)
    assert {motion.tool for motion in job.program.motions} == {cell.tables.tools[0].number}
    assert any("names no tool" in line for line in doubtful_readings(job.program))
    begin = text.index("[[tools]]")
    end = text.index("\n[", begin + 9)
    second = text[begin:end].replace("number = 1", "number = 2")
    (tmp_path / "two.toml").write_text(text[:end] + "\n" + second + text[end:])
    with pytest.raises(ProgramError, match="no tool is selected"):
        read_job(tmp_path / "cut.mpf", read_cell(tmp_path / "two.toml"))
