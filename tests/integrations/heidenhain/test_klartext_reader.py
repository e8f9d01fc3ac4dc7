"""Klartext against closed forms, against scipy's rotations, and against the same part in G-code."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.errors import CounterflexError, ProgramError
from counterflex.core.units import DEG, INCH, MM, MM_PER_MIN
from counterflex.integrations.heidenhain.language.reader import read_heidenhain, read_heidenhain_file
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Program

UNKNOWN = MillingMachine(known=False)
EXAMPLES = Path(__file__).parents[3] / "examples" / "programs"


def read(*lines: str, unit: str = "MM", machine: MillingMachine = MillingMachine()) -> Program:  # noqa: B008
    """A program with its head and its end."""
    text = "\n".join([f"BEGIN PGM T {unit}", *lines, f"END PGM T {unit}", ""])
    return read_heidenhain(text, complete=True, machine=machine)


def ends(program: Program) -> np.ndarray:
    """End points of the motions, mm."""
    return np.array([motion.p_end for motion in program.motions]) / MM


START = ("TOOL CALL 1 Z S1000 F200", "M3", "L X+0 Y+0 Z+5 R0 FMAX", "L Z+0 F100")


def test_the_groove_is_that_of_the_g_code() -> None:
    ours, theirs = read_heidenhain_file(EXAMPLES / "groove.h"), read_gcode((EXAMPLES / "groove.ngc").read_text())
    assert [m.kind for m in ours.motions] == [m.kind for m in theirs.motions]
    np.testing.assert_allclose(ends(ours), ends(theirs), atol=1e-9)
    for a, b in zip(ours.motions, theirs.motions, strict=True):
        assert (a.feed_m_s, a.spindle_rad_s, a.tool) == (b.feed_m_s, b.spindle_rad_s, b.tool)


def test_fmax_acts_in_its_block_and_f_stays() -> None:
    made = read(*START, "L X+5 FMAX", "L X+10", "L X+12 F AUTO", "L X+13")
    assert [m.kind for m in made.motions] == ["rapid", "feed", "rapid", "feed", "feed", "feed"]
    feeds = [m.feed_m_s / MM_PER_MIN for m in made.motions if m.kind == "feed"]
    assert feeds == pytest.approx([100.0, 100.0, 200.0, 200.0])


def test_inch_programs_have_feeds_in_tenths_of_an_inch() -> None:
    made = read("TOOL CALL 1 Z S1000", "L X+0 Y+0 Z+1 R0 FMAX", "L X+2 F50", unit="INCH")
    np.testing.assert_allclose(made.motions[-1].p_end, [2.0 * INCH, 0.0, INCH])
    assert made.motions[-1].feed_m_s == pytest.approx(50.0 * 0.1 * INCH / 60.0)


def test_feed_per_revolution() -> None:
    made = read(*START, "L X+5 FU0.2")
    assert made.motions[-1].feed_m_s == pytest.approx(0.2 * MM * 1000.0 / 60.0)


def test_incremental_and_polar_words() -> None:
    made = read(*START, "L IX+3 IY-2", "CC X+10 Y+0", "LP PR+5 PA+90", "LP IPA+90", "LP IPR+1", "L Y+1")
    expected = [[3, -2, 0], [10, 5, 0], [5, 0, 0], [4, 0, 0], [4, 1, 0]]
    np.testing.assert_allclose(ends(made)[2:], expected, atol=1e-9)


def test_arcs_in_their_forms() -> None:
    """Half a circle in each form: the centre, the sense and the turn are those of the circle."""
    forms = (
        ("CC X+10 Y+0", "C X+20 Y+0 DR-"), ("CR X+20 Y+0 R+10 DR-",), ("CC X+10 Y+0", "CP PA+0 DR-"),
        ("CC X+10 Y+0", "CP IPA-180"), ("CC X+10 Y+0", "CP IPA-180 DR-"),
    )  # fmt: skip
    for lines in forms:
        motion = read(*START, *lines).motions[-1]
        assert motion.p_centre is not None
        np.testing.assert_allclose(motion.p_centre, [10.0 * MM, 0.0, 0.0], atol=1e-12)
        np.testing.assert_allclose(motion.p_end, [20.0 * MM, 0.0, 0.0], atol=1e-12)
        assert motion.turn_rad == pytest.approx(-math.pi)


@pytest.mark.parametrize(("radius", "size"), [("+10", 1.0), ("-10", 5.0)])
def test_the_sign_of_the_radius_chooses_the_arc(radius: str, size: float) -> None:
    motion = read(*START, f"CR X+10 Y+0 R{radius} DR+").motions[-1]
    assert motion.turn_rad == pytest.approx(size * math.pi / 3.0)


def test_a_full_circle_and_a_helix() -> None:
    made = read(*START, "CC X+10 Y+0", "C X+0 Y+0 DR+", "CP IPA+900 IZ-5 DR+")
    assert made.motions[-2].turn_rad == pytest.approx(2.0 * math.pi)
    assert made.motions[-1].turn_rad == pytest.approx(5.0 * math.pi)
    np.testing.assert_allclose(ends(made)[-1], [20.0, 0.0, -5.0], atol=1e-9)


@given(st.floats(-170.0, 170.0), st.floats(5.0, 160.0), st.sampled_from([-1.0, 1.0]), st.floats(2.0, 50.0))
@settings(max_examples=60, deadline=None)
def test_a_tangential_arc_leaves_along_the_line(heading: float, half: float, side: float, chord: float) -> None:
    """The chord of an arc makes half its angle with the tangent; its radius is chord / (2 sin)."""
    a = heading * DEG
    b = a + side * half * DEG
    x, y = 10.0 * math.cos(a), 10.0 * math.sin(a)
    made = read(*START, f"L X{x:+.9f} Y{y:+.9f}", f"CT X{x + chord * math.cos(b):+.9f} Y{y + chord * math.sin(b):+.9f}")
    arc = made.motions[-1]
    assert arc.turn_rad == pytest.approx(side * 2.0 * half * DEG, abs=1e-6)
    assert arc.p_centre is not None
    spoke = np.asarray(arc.p_start) - arc.p_centre
    assert float(np.linalg.norm(spoke)) / MM == pytest.approx(chord / (2.0 * math.sin(half * DEG)), rel=1e-6)
    assert abs(float(spoke[:2] @ [math.cos(a), math.sin(a)])) < 1e-9


@given(st.floats(-160.0, 160.0).filter(lambda angle: abs(angle) > 5.0), st.floats(0.1, 3.0))
@settings(max_examples=60, deadline=None)
def test_a_rounded_corner_is_tangent_to_both_lines(angle: float, radius: float) -> None:
    """RND cuts R tan(angle / 2) off both lines and turns by the angle between them."""
    cut = radius * math.tan(0.5 * abs(angle) * DEG)
    c, s = math.cos(angle * DEG), math.sin(angle * DEG)
    lines = ("L X+50 Y+0", f"RND R{radius:.9f} F40", f"L X{50 + 50 * c:+.9f} Y{50 * s:+.9f}")
    if cut > 50.0:
        with pytest.raises(ProgramError, match="too large"):
            read(*START, *lines)
        return
    into, arc, out = read(*START, *lines).motions[-3:]
    np.testing.assert_allclose(into.p_end[0] / MM, 50.0 - cut, atol=1e-6)
    np.testing.assert_allclose(np.asarray(out.p_start)[:2] / MM, [50.0 + cut * c, cut * s], atol=1e-6)
    assert arc.turn_rad == pytest.approx(angle * DEG)
    assert arc.feed_m_s == pytest.approx(40.0 * MM_PER_MIN)
    assert out.feed_m_s == pytest.approx(100.0 * MM_PER_MIN)
    assert arc.p_centre is not None
    assert float(np.linalg.norm(np.asarray(arc.p_start) - arc.p_centre)) / MM == pytest.approx(radius)


def test_a_repeated_section_and_a_subprogram() -> None:
    made = read(*START, "LBL 1", "L IX+1", "CALL LBL 1 REP 3", "CALL LBL 2", "CALL LBL \"A\"", "M30",
                "LBL 2", "L IY+5", "LBL 0", "LBL \"A\"", "L IY+1", "LBL 0")  # fmt: skip
    np.testing.assert_allclose(ends(made)[-1], [4.0, 6.0, 0.0])
    assert not made.straight


def test_nested_repeats_count_anew() -> None:
    made = read(*START, "LBL 1", "LBL 2", "L IX+1", "CALL LBL 2 REP 2", "L IY+1", "CALL LBL 1 REP 1")
    np.testing.assert_allclose(ends(made)[-1], [6.0, 2.0, 0.0])


def test_parameters_formulas_and_jumps() -> None:
    made = read(
        *START, "FN 0: Q1 = +4", "FN 1: Q2 = +Q1 + +1", "FN 3: Q3 = +Q2 * +2", "FN 4: Q4 = +Q3 DIV +4",
        "FN 6: Q5 = SIN+30", "FN 8: Q6 = +3 LEN +4", "FN 13: Q7 = +1 ANG +1", "Q8 = (Q1 + Q2) * SQ 2 - SQRT 16",
        "QL1 = -Q5 * 2", "LBL 1", "FN 2: Q1 = +Q1 - +1", "FN 11: IF +Q1 GT +0 GOTO LBL 1",
        "L X+Q4 Y+Q6 Z-QL1", "L XQ7 Y+Q8 Z+Q1",
    )  # fmt: skip
    np.testing.assert_allclose(ends(made)[-2:], [[2.5, 5.0, 1.0], [45.0, 32.0, 0.0]], atol=1e-9)


def test_a_called_program_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "SUB.H").write_text("BEGIN PGM SUB INCH\nL X+1 FMAX\nEND PGM SUB INCH\n")
    main = tmp_path / "main.h"
    main.write_text("BEGIN PGM M MM\nL X+0 Y+0 Z+0 R0 FMAX\nCALL PGM TNC:\\PARTS\\sub.h\nL Y+1 FMAX\nEND PGM M MM\n")
    made = read_heidenhain_file(main)
    np.testing.assert_allclose(ends(made)[-2:], [[25.4, 0, 0], [25.4, 1, 0]])
    assert made.blocks[made.motions[1].block].file == "SUB.H"
    main.write_text("BEGIN PGM M MM\nCALL PGM OTHER\nEND PGM M MM\n")
    with pytest.raises(ProgramError, match=r"main\.h:2:\d+.*not in the folder"):
        read_heidenhain_file(main)


angle = st.integers(-180, 180)


@given(angle, angle, angle, st.tuples(*[st.integers(-50, 50)] * 3), st.tuples(*[st.integers(-50, 50)] * 3))
@settings(max_examples=60, deadline=None)
def test_spatial_angles_turn_about_fixed_axes_in_the_order_a_b_c(
    a: int, b: int, c: int, shift: tuple[int, ...], point: tuple[int, ...]
) -> None:
    """PLANE SPATIAL about the datum of cycle 7: scipy's extrinsic xyz."""
    R = Rotation.from_euler("xyz", [a, b, c], degrees=True)
    dx, dy, dz = shift
    x, y, z = point
    made = read(
        *START, "CYCL DEF 7.0 DATUM SHIFT", f"CYCL DEF 7.1 X{dx:+d}", f"CYCL DEF 7.2 Y{dy:+d}",
        f"CYCL DEF 7.3 Z{dz:+d}",
        f"PLANE SPATIAL SPA{a:+d} SPB{b:+d} SPC{c:+d} TURN MB MAX FMAX SEQ- TABLE ROT", f"L X{x:+d} Y{y:+d} R0 FMAX",
        f"L Z{z:+d} R0 FMAX",
    )  # fmt: skip
    motion = made.motions[-1]
    np.testing.assert_allclose(np.asarray(motion.p_end) / MM, np.array(shift) + R.apply(point), atol=1e-9)
    np.testing.assert_allclose(motion.abc_end, R.as_matrix()[:, 2], atol=1e-12)
    assert made.blocks[motion.block].modal.tool_centre == TOOL_VECTOR


FORMS = {
    "PLANE EULER EULPR+20 EULNU+30 EULROT+40": Rotation.from_euler("ZXZ", [20, 30, 40], degrees=True).as_matrix(),
    "PLANE VECTOR BX+0 BY+2 BZ+0 NX+3 NY+0 NZ+0": np.column_stack([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "PLANE POINTS P1X+5 P1Y+0 P1Z+0 P2X+9 P2Y+0 P2Z+0 P3X+5 P3Y+0 P3Z+3":
        np.column_stack([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "PLANE SPATIAL SPA+0 SPB+30 SPC+0 TURN FMAX\nPLANE RELATIV SPA+20":
        Rotation.from_euler("YX", [30, 20], degrees=True).as_matrix(),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_other_forms_of_the_plane(form: str) -> None:
    motion = read(*START, f"{form} TURN FMAX", "L X+1 Y+2 Z+3 R0 FMAX").motions[-1]
    np.testing.assert_allclose(np.asarray(motion.p_end) / MM, FORMS[form] @ [1.0, 2.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(motion.abc_end, FORMS[form][:, 2], atol=1e-12)


def test_a_plane_that_stays_is_turned_to_by_its_own_angles() -> None:
    tilted = (*START, "PLANE SPATIAL SPA+0 SPB+30 SPC+0 STAY")
    with pytest.raises(ProgramError, match="before the tool has been turned"):
        read(*tilted, "L X+0 Y+0 Z+5 R0 FMAX", "L Z+0 F100")
    made = read(*tilted, "L B+Q121 C+Q122 R0 FMAX", "L X+0 Y+0 Z+5 R0 FMAX", "L Z+0 F100", "PLANE RESET STAY",
                "L B+0 C+0 FMAX", "L X+0 Y+0 Z+50 FMAX")  # fmt: skip
    np.testing.assert_allclose(made.motions[-2].abc_end, [0.5, 0.0, math.cos(30 * DEG)], atol=1e-12)
    np.testing.assert_allclose(made.motions[-1].abc_end, [0.0, 0.0, 1.0])


def test_tool_vectors_and_rotary_words_under_m128() -> None:
    made = read(*START, "M128 F1000", "LN X+1 Y+2 Z+3 TX+0.6 TY+0 TZ+0.8 R0 F500", "M129")
    np.testing.assert_allclose(made.motions[-1].abc_end, [0.6, 0.0, 0.8])
    made = read(*START, "FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS", "L X+1 B+30 C-90 F500", "FUNCTION RESET TCPM")
    np.testing.assert_allclose(made.motions[-1].abc_end, np.array([0.0, 30.0, -90.0]) * DEG)
    assert made.blocks[made.motions[-1].block].modal.tool_centre == TOOL_CENTRE
    made = read(*START, "M126", "L C+350 FMAX", "L C+10 FMAX", "M127")
    assert made.motions[-1].abc_end[2] - made.motions[-1].abc_start[2] == pytest.approx(20.0 * DEG)


def test_frames_one_after_the_other() -> None:
    """Shift, then rotation, then mirror image, then scale: each in the axes before it."""
    made = read(
        *START, "CYCL DEF 7.0 DATUM", "CYCL DEF 7.1 X+100", "CYCL DEF 7.2 IY+10", "CYCL DEF 10.0 ROT",
        "CYCL DEF 10.1 ROT+30", "L X+10 Y+5 FMAX", "CYCL DEF 8.0 MIRROR", "CYCL DEF 8.1 X",
        "L X+10 Y+5 FMAX", "CR X+10 Y+15 R+5 DR+ F100", "CYCL DEF 8.0 MIRROR", "CYCL DEF 8.1", "CYCL DEF 10.0 ROT",
        "CYCL DEF 10.1 IROT-30", "CYCL DEF 26.0 SCALE", "CYCL DEF 26.1 X2 Y0.5 CCX+10 CCY+0", "L X+12 Y+4 FMAX",
    )  # fmt: skip
    R = Rotation.from_euler("z", 30, degrees=True)
    p = ends(made)[2:]
    np.testing.assert_allclose(p[0], np.array([100, 10, 0]) + R.apply([10, 5, 0]), atol=1e-9)
    np.testing.assert_allclose(p[1], np.array([100, 10, 0]) + R.apply([-10, 5, 0]), atol=1e-9)
    np.testing.assert_allclose(p[2], np.array([100, 10, 0]) + R.apply([-10, 15, 0]), atol=1e-9)
    np.testing.assert_allclose(p[3], [114, 12, 0], atol=1e-9)
    arc = made.motions[4]
    middle = np.asarray(arc.p_centre) + Rotation.from_rotvec(0.5 * arc.turn_rad * np.asarray(arc.normal)).apply(
        np.asarray(arc.p_start) - np.asarray(arc.p_centre)
    )
    np.testing.assert_allclose(middle / MM, np.array([100, 10, 0]) + R.apply([-15, 10, 0]), atol=1e-9)


CYCLE = "CYCL DEF 200 DRILLING ~\nQ200=2 ;CLEARANCE ~\nQ201=-5 ;DEPTH ~\nQ206=150 ~\nQ202={q202} ~\nQ210=0.5 ~\n" \
        "Q203=+1 ~\nQ204=20 ~\nQ211=0"  # fmt: skip


def test_drilling_pecks_down_to_its_depth() -> None:
    made = read(*START, CYCLE.format(q202=2), "L X+10 Y+3 R0 FMAX M99", "L X+20 R0 FMAX", "CYCL CALL")
    ours = [m for m in made.motions if made.blocks[m.block].line == 15]
    heights = [(m.kind, round(float(m.p_end[2]) / MM, 6)) for m in ours]
    assert heights == [
        ("rapid", 0.0), ("rapid", 3.0), ("feed", -1.0), ("rapid", 3.0), ("dwell", 3.0), ("rapid", 1.0), ("feed", -3.0),
        ("rapid", 3.0), ("dwell", 3.0), ("rapid", -1.0), ("feed", -4.0), ("rapid", 21.0),
    ]  # fmt: skip
    assert {round(m.feed_m_s / MM_PER_MIN) for m in ours if m.kind == "feed"} == {150}
    np.testing.assert_allclose(ends(made)[-1], [20.0, 3.0, 21.0])


def test_reaming_comes_out_at_its_feed() -> None:
    cycle = "CYCL DEF 201 REAMING ~\nQ200=2 ~\nQ201=-5 ~\nQ206=150 ~\nQ211=0.25 ~\nQ208=250 ~\nQ203=+0 ~\nQ204=20"
    made = read(*START, cycle, "L X+10 R0 FMAX M99")
    shown = [(m.kind, round(float(m.p_end[2]) / MM, 6), round(m.feed_m_s / MM_PER_MIN)) for m in made.motions[3:]]
    assert shown == [("rapid", 2.0, 0), ("feed", -5.0, 150), ("dwell", -5.0, 0), ("feed", 2.0, 250), ("rapid", 20.0, 0)]


coordinate = st.integers(-4000, 4000).map(lambda value: value / 100.0)


@given(
    st.lists(
        st.tuples(st.sampled_from(["G0", "G1", "G2", "G3", "R2", "R3", "dwell"]), *[coordinate] * 3),
        min_size=1,
        max_size=12,
    )
)
@settings(max_examples=120, deadline=None)
def test_the_same_part_in_g_code_is_the_same_path(moves: list[tuple[str, float, float, float]]) -> None:
    gcode = ["G21 G90 G17 G54", "T3 M6", "S2500 M3", "G0 X0 Y0 Z0"]
    klartext = ["TOOL CALL 3 Z S2500", "M3", "L X+0 Y+0 Z+0 R0 FMAX"]
    x = y = 0.0
    for word, u, v, w in moves:
        sense = "DR-" if word[1:] == "2" else "DR+"
        if word in ("G0", "G1"):
            gcode.append(f"{word} X{u} Y{v} Z{w}" + (" F600" if word == "G1" else ""))
            klartext.append(f"L X{u:+} Y{v:+} Z{w:+} R0 " + ("F600" if word == "G1" else "FMAX"))
        elif word == "dwell":
            gcode.append("G4 P0.5")
            klartext += ["CYCL DEF 9.0 DWELL TIME", "CYCL DEF 9.1 DWELL 0.5"]
            continue
        elif math.hypot(u - x, v - y) < 0.1:
            continue
        elif word[0] == "G":
            cx, cy = 0.5 * (x + u), 0.5 * (y + v)
            gcode.append(f"{word} X{u} Y{v} I{cx - x:.6f} J{cy - y:.6f} F600")
            klartext += [f"CC X{cx:+.6f} Y{cy:+.6f}", f"C X{u:+} Y{v:+} {sense} F600"]
        else:
            radius = math.copysign(math.hypot(u - x, v - y), w)
            gcode.append(f"G{word[1]} X{u} Y{v} R{radius:.6f} F600")
            klartext.append(f"CR X{u:+} Y{v:+} R{radius:+.6f} {sense} F600")
        x, y = u, v
    ours, theirs = read(*klartext), read_gcode("\n".join([*gcode, "M30", ""]))
    assert len(ours.motions) == len(theirs.motions)
    for a, b in zip(ours.motions, theirs.motions, strict=True):
        assert (a.kind, a.tool, a.duration_s, a.spindle_rad_s) == (b.kind, b.tool, b.duration_s, b.spindle_rad_s)
        np.testing.assert_allclose(a.p_end, b.p_end, atol=1e-9)
        assert a.feed_m_s == pytest.approx(b.feed_m_s)
        assert a.turn_rad == pytest.approx(b.turn_rad, abs=1e-6)
        if b.p_centre is not None:
            assert a.p_centre is not None
            np.testing.assert_allclose(a.p_centre, b.p_centre, atol=1e-8)


BAD = {
    "L X+5 RL F100": "radius compensation",
    "L X+5 FZ0.1": "feed per tooth",
    "LN X+1 NX+0 NY+0 NZ+1 F9": "surface normals",
    "APPR LT X+1 LEN5 RL": "approach functions",
    "CHF 5": "chamfer or of its sides",
    "C X+1 Y+1 DR+": "without a circle centre",
    "CYCL DEF 203 UNIVERSAL DRILLING": "CYCL DEF 203",
    "CYCL DEF 7.0\nCYCL DEF 7.1 #5": "datum table",
    "CYCL DEF 11.0 S\nCYCL DEF 11.1 SCL0.9": "machine parameter",
    "CYCL DEF 19.0 W\nCYCL DEF 19.1 A+5 B+5 C+0": "spatial",
    "PLANE AXIAL B+30 STAY": "rotary axes",
    "TOOL CALL 2 Z DL+0.1": "delta of the tool length",
    "TOOL CALL 2 X": "tool axis",
    'TOOL CALL "DRILL" Z': "no tool of this name",
    "L X+Q5 F100": "nothing in the program gives Q5",
    "FN 18: SYSREAD Q5 = ID1 NR1\nL X+Q5 FMAX": "the control gives it",
    "CALL LBL 9": "no LBL 9",
    "M70": "machine builder",
    "L X+1 M136": "M136",
    "CYCL CALL": "none has been defined",
    "Q1 = 5 / 0": "division by zero",
    "FOO BAR": "unknown statement",
    "L X+1 W+3 FMAX": "unknown word",
    "L X+1 X+2 FMAX": "twice",
    "CP IPA+90 DR+": "without a pole",
    "L X+1 IX+2 FMAX": "both|and incrementally",
    "CC X+1 IX+2": "both|and incrementally",
    "CYCL DEF 10.0 R\nCYCL DEF 10.1 ROT+30\nL X+5 FMAX": "leaves out an axis",
    "CYCL DEF 10.0 R\nCYCL DEF 10.1 ROT+30\nCYCL DEF 7.0 D\nCYCL DEF 7.1 X+5\nCYCL DEF 10.0 R\nCYCL DEF 10.1 ROT+40":
        "acts first",
    "CYCL DEF 7.0 D\nCYCL DEF 7.1 X+5\nL IX+5 FMAX": "its datum changed",
    "RND R5\nL Z+50 FMAX": "RND before another motion",
    "CYCL DEF 247 P ~\nQ339=+1": "preset 1",
    "L X+1 R0 F100 M91\nL X+2 F100": "",
    "Q1 = SIN Q2 ^ 2": "write brackets",
    "L Z+1 FMAX M91\nL X+2 F100": "after M91",
    "L Z+5 R0 FMAX M140 MB MAX\nL X+2 FMAX": "after M140",
    "LBL 3\nCALL LBL 3 REP 2\nLBL 3": "set twice",
    "LBL 4\nFN 9: IF +1 EQU +1 GOTO LBL 4": "never ends",
    "LBL 5\nCALL LBL 5": "nested deeper",
}  # fmt: skip


@pytest.mark.parametrize("lines", BAD)
def test_what_is_not_known_is_refused_with_its_place(lines: str) -> None:
    with pytest.raises(ProgramError, match=rf"part\.h:\d+:\d+: .*({BAD[lines]})") as caught:
        read_heidenhain("\n".join(["BEGIN PGM T MM", *START, *lines.split("\n"), "END PGM T MM"]), name="part.h",
                        machine=UNKNOWN)  # fmt: skip
    assert "\n" not in str(caught.value)


def test_heads_and_ends_are_required() -> None:
    with pytest.raises(ProgramError, match="begins with BEGIN PGM"):
        read_heidenhain("L X+1 FMAX\n")
    with pytest.raises(ProgramError, match="stops without END PGM"):
        read_heidenhain("BEGIN PGM T MM\nL X+1 FMAX\n", complete=True)
    with pytest.raises(ProgramError, match="empty"):
        read_heidenhain("\n")


def test_a_feed_from_an_unknown_place_is_refused() -> None:
    with pytest.raises(ProgramError, match="not known where the tool is along X and Y"):
        read("L Z+5 R0 FMAX", "L X+5 F100", machine=UNKNOWN)


WORDS = st.sampled_from(
    ["L", "LN", "LP", "CC", "C", "CP", "CR", "CT", "CTP", "RND", "X+1", "Y-2.5", "Z+0", "IX+3", "IY+Q1", "PR+5",
     "PA+30", "IPA+90", "DR+", "DR-", "R+5", "R0", "RL", "F100", "FMAX", "F AUTO", "FU0.1", "M3", "M91", "M99", "M128",
     "B+10", "TX+0.1", "TOOL CALL", "1 Z S100", "CYCL DEF", "7.0 X", "CYCL DEF 7.1 X+5",
     "CYCL DEF 10.0\nCYCL DEF 10.1 ROT+5",
     "CYCL DEF 8.0\nCYCL DEF 8.1 X", "CYCL CALL", "PLANE SPATIAL", "SPA+1 SPB+2 SPC+3 TURN", "STAY", "PLANE RESET STAY",
     "LBL 1", "LBL 0", "CALL LBL 1", "REP 2", "Q1 = 2 + 3", "FN 1: Q2 = +1 + +2", "FN 9: IF +Q1 EQU +1 GOTO LBL 1", "~",
     ";c", "* -", "BLK FORM 0.1 Z X+0", "STOP", "M30", "END PGM A MM", "12", "/", "\"", "Q99999999999", "9" * 400,
     "1e5",     "CYCL DEF 26.0\nCYCL DEF 26.1 X2", CYCLE.format(q202=1), "CYCL DEF 247", "CALL PGM X", "FUNCTION TCPM"]
)  # fmt: skip
LINE = st.one_of(st.lists(WORDS, max_size=6).map(" ".join), st.text(max_size=12),
                 st.text(alphabet="LXYZQ0123456789.+-=;~ \"", max_size=20))  # fmt: skip


@settings(max_examples=500, deadline=None)
@given(st.lists(LINE, max_size=10))
def test_any_text_is_read_or_refused_in_one_line(lines: list[str]) -> None:
    text = "\n".join(["BEGIN PGM A MM", "TOOL CALL 1 Z S1000 F100", "M3", *lines])
    try:
        program = read_heidenhain(text, name="any.h")
    except CounterflexError as fault:
        said = str(fault)
        assert "\n" not in said
        name, row, column = str(fault.where).split(":")
        assert (name, int(row) >= 1, int(column) >= 1) == ("any.h", True, True)
        return
    assert sum(block.motion_count for block in program.blocks) == len(program.motions)
    for number, block in enumerate(program.blocks):
        assert all(program.motions[k].block == number for k in range(block.first_motion, block.first_motion
                                                                      + block.motion_count))  # fmt: skip
    for motion in program.motions:
        assert np.all(np.isfinite(motion.p_end))
        assert motion.kind in ("rapid", "dwell") or motion.feed_m_s + motion.feed_rad_s > 0.0


def test_axes_that_a_new_plane_gets_one_after_the_other_belong_to_its_first_motion() -> None:
    """What looks for the first block that names an axis must not find a later one."""
    made = read(*START, "PLANE SPATIAL SPA+0 SPB+15 SPC+0 TURN FMAX", "L X+1 Y+2 R0 FMAX", "L Z+3 FMAX", "L Y+9 F100")
    first = made.blocks[made.motions[2].block]
    assert {(word.letter, word.value) for word in first.words} == {("X", 1.0), ("Y", 2.0), ("Z", 3.0)}
    np.testing.assert_allclose(np.asarray(made.motions[3].p_start)[1] / MM, 2.0)
