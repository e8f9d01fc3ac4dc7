"""Cutter location files in APT: read, and written back with targets replaced."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import INCH, MM, MM_PER_MIN
from counterflex.integrations.siemens.language.reader import read_sinumerik
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.programs.apt.reader import read_apt
from counterflex.programs.apt.writer import write_apt
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.program import TOOL_VECTOR, Program
from counterflex.programs.reading import read_program_file
from counterflex.programs.rotary.fitted import fitted
from counterflex.programs.rotary.poses import CommandedWords, RotaryWords, turned_path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "programs"
TOLERANCE = 5e-6
READERS: dict[str, Callable[[str], Program]] = {"linuxcnc": read_gcode, "sinumerik": read_sinumerik, "apt": read_apt}
ROUNDING = 1e-7 * 0.87 + 1e-9
GROOVE_MM = ((-12, 15, 42), (-12, 15, 34), (72, 15, 34))
ARC = "RAPID\nGOTO/10,0,5\nCIRCLE/0,0,5,0,0,1,10,0.06,0.5,0,0\nGOTO/0,10,5\nCIRCLE/0,0,5,0,0,-1,10\nGOTO/10,0,4\n"


def ends(program: Program) -> list[list[float]]:
    return [[round(float(x) / MM, 9) + 0.0 for x in motion.p_end] for motion in program.motions]


def test_points_feeds_spindle_and_tool() -> None:
    program = read_apt(
        "PARTNO/A $$ B\nUNITS / MM\nLOADTL/ 3,ADJUST,1\nSPINDL/RPM, 900 ,CCLW\nCOOLNT/FLOOD\n$$ text\nFROM/0.,0.,9.\n"
        "RAPID\nGOTO/ 1.5,-.5,1E1\nFEDRAT/ 250.,MMPM\ngoto/2,-.5,$ more\n 10\nGODLTA/1,0,-1\nDELAY/2\nFINI\nnot read\n"
    )
    assert [m.kind for m in program.motions] == ["rapid", "feed", "feed", "dwell"]
    assert ends(program) == [[1.5, -0.5, 10], [2, -0.5, 10], [3, -0.5, 9], [3, -0.5, 9]]
    assert program.motions[1].feed_m_s == pytest.approx(250 * MM_PER_MIN)
    assert {m.tool for m in program.motions} == {3}
    assert program.motions[1].spindle_rad_s == pytest.approx(-900 * 2 * np.pi / 60)
    assert program.motions[3].duration_s == 2.0


def test_statements_as_nx_and_catia_write_them() -> None:
    program = read_apt("TPRINT/T1 End mill D 16, long\nLOAD/TOOL,2\nRAPID\nGOTO/1,2,3\nSELECT/TOOL,3\n")
    assert program.motions[0].tool == 2


def test_feed_units() -> None:
    text = "UNITS/{}\nSPINDL/100,RPM,CLW\nFEDRAT/{}\nGOTO/1,0,0"
    feeds = [
        read_apt(text.format(unit, feed)).motions[0].feed_m_s
        for unit, feed in (("MM", "60"), ("INCHES", "60"), ("INCH", "MMPM,60"), ("MM", "2,IPM"), ("MM", "0.6,MMPR"))
    ]
    assert feeds == pytest.approx([60 * MM_PER_MIN, INCH, 60 * MM_PER_MIN, 2 * INCH / 60, 60 * MM_PER_MIN])


def test_circle_is_the_arc_of_g_code() -> None:
    ours = read_apt("FEDRAT/500,MMPM\n" + ARC.replace("RAPID\n", "RAPID\n", 1) + "FEDRAT/500\n")
    reference = read_gcode("G21 G90 F500\nG0 X10 Y0 Z5\nG3 X0 Y10 I-10 J0\nG2 X10 Y0 Z4 J-10")
    for motion, truth in zip(ours.motions, reference.motions, strict=True):
        assert motion.p_end == pytest.approx(truth.p_end, abs=1e-12)
        assert motion.turn_rad == pytest.approx(truth.turn_rad, abs=1e-12)


def test_tool_axes() -> None:
    text = "MULTAX/ON\nRAPID\nGOTO/0,0,9,0,0,1\nFEDRAT/900,MMPM\nGOTO/5,0,9,0.6,0,0.8\nGOTO/6,0,9\n"
    program = read_apt(text)
    assert [m.abc_end for m in program.motions] == [(0, 0, 1), (0.6, 0, 0.8), (0.6, 0, 0.8)]
    assert {b.modal.tool_centre for b in program.blocks} == {TOOL_VECTOR}
    assert read_apt("TLAXIS/0,0.6,0.8\nRAPID\nGOTO/1,2,3").motions[0].abc_end == (0, 0.6, 0.8)
    upright = read_apt(text.replace("0.6,0,0.8", "0,0,1"))
    assert {b.modal.tool_centre for b in upright.blocks} == {0}


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("GOTOO/1,2,3", r"part:2:1: an unknown word of APT: GOTOO; got GOTOO/1,2,3\. Did you mean GOTO"),
        ("GOTO/1,2", "GOTO needs 3 or 6 numbers"),
        ("GOTO/1,,2", r"part:2:8: an argument is missing"),
        ("GOTO/1,2,X", "GOTO needs 3 or 6 numbers"),
        ("GOTO/1,2,3,0,0,2", r"part:2:12: the tool axis needs three numbers of length 1"),
        ("GOTO/1,2,3", "a feed move without a feed"),
        ("FEDRAT/100,FURLONG", r"part:2:12: an unknown word of APT in FEDRAT; got FURLONG"),
        ("SPINDL/SFM,100", "an unknown word of APT in SPINDL; got SFM"),
        ("COOLNT/TWICE", "an unknown word of APT in COOLNT"),
        ("CYCLE/DRILL,10", "machining cycles are not read: CYCLE"),
        ("CUTCOM/LEFT", "cutter radius compensation is not read"),
        ("CIRCLE/0,0,0,0,0.6,0.8,5", "an arc about a slanted axis"),
        ("CIRCLE/0,0,0,5", "CIRCLE needs centre, axis and radius"),
        ("FEDRAT/9\nCIRCLE/0,0,0,0,0,1,5\nGOTO/9,9,0", "part:3:1: the arc"),
        ("TLLFT,GOLFT/L1,PAST,L2", "geometry that a post processor must solve"),
        ("TLON,GOFWD/L1,ON,L2", "geometry that a post processor must solve"),
        ("AUXFUN/77", "a function of the machine that is not read: AUXFUN"),
        ("LOADTL/1E400", "part:2:8: a number is out of range; got 1E400"),
        ("LOADTL/BORE", "an unknown word of APT in LOADTL"),
        ("LOAD/TURRET,1", "an unknown word of APT in LOAD; got TURRET"),
        ("LOAD/1", "of LOAD only LOAD/TOOL is read"),
        ("UNITS/FURLONG", "an unknown unit of length"),
        ("GOTO/1,2,$", "the file ends within a statement"),
        ("?", "this is no statement of APT"),
    ],
)
def test_refusals_name_word_and_line(line: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match):
        read_apt(f"UNITS/MM\n{line}", name="part")


def test_program_without_end() -> None:
    with pytest.raises(ProgramError, match="stops without FINI or END-OF-PATH"):
        read_apt("RAPID\nGOTO/1,2,3\n", complete=True)


# One groove in three languages ----------------------------------------------------------------------------------------

PLUNGE, CUT = 3000, 1500


def grooves() -> dict[str, Program]:
    a, b, c = (" ".join(f"{n}{v}" for n, v in zip("XYZ", p, strict=True)) for p in GROOVE_MM)
    gcode = f"G21 G90 G17\nT1 M6\nS13000 M3\nG0 {a}\nG1 {b} F{PLUNGE}\n{c} F{CUT}\nG0 X72 Y15 Z60\nM2\n"
    a, b, c = (",".join(map(str, p)) for p in GROOVE_MM)
    apt = (
        f"UNITS/MM\nLOADTL/1\nSPINDL/13000,RPM,CLW\nRAPID\nGOTO/{a}\nFEDRAT/{PLUNGE},MMPM\nGOTO/{b}\n"
        f"FEDRAT/{CUT},MMPM\nGOTO/{c}\nRAPID\nGOTO/72,15,60\nFINI\n"
    )
    return {
        "linuxcnc": read_gcode(gcode),
        "sinumerik": read_sinumerik(gcode.replace("G21", "G71")),
        "apt": read_apt(apt),
    }


def test_one_groove_in_three_languages_is_one_path_and_gets_the_same_targets() -> None:
    read = grooves()
    paths = {name: tool_path(program, step_m=1e-3) for name, program in read.items()}
    nominal, targets = paths["linuxcnc"], {}
    for name, path in paths.items():
        assert path.p_part_tcp == pytest.approx(nominal.p_part_tcp, abs=1e-9)
        assert path.time_s == pytest.approx(nominal.time_s, abs=1e-9)
        assert np.array_equal(path.tool, nominal.tool)
        assert path.spindle_rad_s == pytest.approx(nominal.spindle_rad_s)
        write = write_apt if name == "apt" else write_gcode
        text = write(read[name], corrected(path, 3e-4), tolerance_m=TOLERANCE).text
        back = READERS[name](text)
        targets[name] = np.array([[*m.p_end, m.feed_m_s] for m in back.motions])
    assert len(targets["linuxcnc"]) > 10
    for name in ("sinumerik", "apt"):
        assert targets[name] == pytest.approx(targets["linuxcnc"], abs=1e-12)


def test_the_example_is_the_groove_of_the_other_languages() -> None:
    ours, reference = (read_program_file(EXAMPLES / f"groove.{ending}") for ending in ("apt", "mpf"))
    assert ours.dialect == "apt"
    assert ends(ours)[1:] == ends(reference)[2:]
    assert [m.feed_m_s for m in ours.motions][1:] == [m.feed_m_s for m in reference.motions][2:]


# Writing back ---------------------------------------------------------------------------------------------------------

NUMBER = st.integers(-400, 400).map(lambda n: f"{n / 10:g}")
POINT = st.tuples(NUMBER, NUMBER, NUMBER)
SHAPES = ("GOTO/{},{},{}", "GOTO / {}, {},{} $$ text 1,2", "GODLTA/{},{},{}", "GOTO/{},$\n  {},{}",
          "RAPID\nGOTO/{},{},{}", "GOTO/{},{},{},0,0,1")  # fmt: skip
MOVE = st.tuples(POINT, st.sampled_from(SHAPES))
OTHER = st.sampled_from(
    ["", "$$ only text 3,4", "PPRINT/TEXT $ AND MORE", "FEDRAT/700,MMPM", "COOLNT/ON", "DELAY/0.5", "STOP", "MULTAX/ON",
     "SPINDL/500,RPM,CLW", "INTOL/0.01"]
)  # fmt: skip
ARC_TEXT = "GOTO/10,0,5\nCIRCLE/0,0,5,0,0,1,10,0.06,0.5,0,0 $$ arc\nGOTO/0,10,5"


@st.composite
def files(draw: st.DrawFn) -> str:
    move = MOVE.map(lambda drawn: drawn[1].format(*drawn[0]))
    parts = draw(st.lists(st.one_of(move, move, OTHER, st.just(ARC_TEXT)), min_size=1, max_size=8))
    return "\n".join(["UNITS/MM", "FEDRAT/600,MMPM", "RAPID", "GOTO/0,0,0", *parts, "FINI", "after the end"]) + "\n"


def corrected(path: ToolPath, size_m: float) -> CompensatedPath:
    p = path.p_part_tcp
    shift = size_m * np.stack([np.sin(90 * p[:, 0] + 1), np.cos(70 * p[:, 0]), np.sin(57 * p[:, 0])], axis=1)
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


def bare(line: str) -> str:
    """A line of a target without its numbers; every other line as it is."""
    code, mark, text = line.partition("$$")
    if re.match(r"\s*(GOTO|GODLTA|CIRCLE)", code):
        return "GOTO" + mark + text
    return line


@settings(max_examples=40, deadline=None)
@given(files(), st.sampled_from(["\n", "\r\n"]))
def test_what_is_no_target_stays_byte_for_byte(text: str, newline: str) -> None:
    program = read_apt(text.replace("\n", newline), name="p.apt", complete=True)
    path = tool_path(program, step_m=2e-3)
    assert write_apt(program, CompensatedPath.nominal(path)).text == text.replace("\n", newline)
    wanted = corrected(path, 2e-4)
    result = write_apt(program, wanted, tolerance_m=TOLERANCE, header=False)
    assert result.text.count(newline) == result.text.count("\n")
    targets = ("GOTO", "GODLTA", "CIRCLE", "  ")
    lines = iter(result.text.splitlines())
    for line in text.splitlines():
        if not line.startswith(targets):
            assert any(line == other for other in lines), line
    if "GODLTA" not in text:
        assert text.count("$$") == result.text.count("$$") or "CIRCLE" in text
    back = read_apt(result.text, name="p.apt", complete=True)
    rows = np.flatnonzero((path.kind == FEED) & (path.feed_m_s > 0.0))
    again = tool_path(back, step_m=2e-3, chord_m=5e-8)
    if len(rows):
        assert distance(wanted.p_part_command[rows], again.p_part_tcp) <= TOLERANCE + ROUNDING
    last = max(k for k, m in enumerate(path.motion) if program.motions[m].kind != "dwell")  # a dwell stays there
    assert again.p_part_tcp[-1] == pytest.approx(wanted.p_part_command[last], abs=ROUNDING)
    assert sum(m.duration_s for m in back.motions) == pytest.approx(sum(m.duration_s for m in program.motions))
    assert result.largest_written_error_m <= TOLERANCE + 2 * ROUNDING


def test_a_shifted_arc_stays_an_arc() -> None:
    program = read_apt("FEDRAT/500,MMPM\n" + ARC + "FINI\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.tile([1e-4, -2e-4, 3e-4], (len(path), 1))
    shift[0] = 0.0
    out = write_apt(program, CompensatedPath.from_correction(path, shift), header=False)
    assert out.arcs_kept == 2
    assert "CIRCLE/0.1000,-0.2000,5.3000,0,0,1,10.0000,0.06,0.5,0,0\nGOTO/0.1000,9.8000,5.3000\n" in out.text


# A tool that turns ----------------------------------------------------------------------------------------------------

TILTED = ((0, 0, 20), (5, 0, 20), (30, 4, 19), (30, 4, 40))


def tilted_texts() -> tuple[str, str]:
    """One path with a tool axis that turns, in Sinumerik and APT."""
    axes = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, 0.6, 0.8]])
    mpf, apt = ["G71 G90", "T1 M6", "TRAORI"], ["UNITS/MM", "LOADTL/1", "MULTAX/ON"]
    for k, (p, axis) in enumerate(zip(TILTED, axes, strict=True)):
        rapid = k in (0, 3)
        x, y, z = p
        i, j, w = axis
        mpf.append(f"{'G0' if rapid else 'G1'} X{x} Y{y} Z{z} A3={i} B3={j} C3={w}{'' if rapid else ' F900'} ; point")
        apt += ["RAPID" if rapid else "FEDRAT/900,MMPM", f"GOTO/{x},{y},{z},{i},{j},{w} $$ point"]
    return "\n".join([*mpf, "TRAFOOF", "M30", ""]), "\n".join([*apt, "FINI", ""])


def test_a_tool_that_turns_gets_the_same_points_and_axes_in_both_languages() -> None:
    mpf, apt = tilted_texts()
    targets = []
    for text, read, write in ((mpf, read_sinumerik, write_gcode), (apt, read_apt, write_apt)):
        program = fitted(read(text), None)
        words = RotaryWords.of(program, None)
        turned = turned_path(program, words, step_m=1e-3, rapid_speed_m_s=0.5)
        fed = (turned.path.kind == FEED)[:, None]
        shift, tilt = np.where(fed, [2e-4, -1e-4, 3e-4], 0.0), np.where(fed, [0.0, 3e-4, -2e-4], 0.0)
        shift[0] = tilt[0] = 0.0
        commanded = CommandedWords.of(turned, words, shift, tilt)
        still = CommandedWords.of(turned, words, 0.0 * shift, 0.0 * tilt)
        nominal = CompensatedPath.nominal(turned.path)
        assert write(program, nominal, words=still).text == text
        result = write(program, nominal, words=commanded, header=False).text
        assert result.count(" point") == 4
        back = read(result)
        targets.append(
            np.array([[*m.p_end, *(np.array(m.abc_end) / np.linalg.norm(m.abc_end))] for m in back.motions[:-1]])
        )
    assert len(targets[0]) > 5
    assert targets[0] == pytest.approx(targets[1], abs=2e-7)
    assert targets[0][1, :3] - targets[0][0, :3] != pytest.approx([0, 0, 0], abs=1e-5)


TOKENS = st.sampled_from(
    ["GOTO/", "GODLTA/", "CIRCLE/0,0,0,0,0,1,", "RAPID", "FEDRAT/", "MMPM", "1,2,3", ",", "-.5", "1E400", "$", "$$",
     "/", "\n",
     "LOADTL/", "SPINDL/", "DELAY/", "UNITS/MM", "TLAXIS/", "MSYS/", "é", " ", "FINI", "PPRINT"]
)  # fmt: skip


@settings(max_examples=100, deadline=None)
@given(st.lists(TOKENS, max_size=25).map("".join))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        read_apt("RAPID\nGOTO/0,0,0\nFEDRAT/5\n" + text)
    except ProgramError as fault:
        assert "\n" not in str(fault)  # noqa: PT017 -- most texts are refused, some are read
