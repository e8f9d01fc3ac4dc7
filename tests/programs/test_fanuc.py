"""FANUC TP listings: read as another reader reads them, written back with only positions and speeds changed."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM, RPM, UM
from counterflex.geometry import rotation
from counterflex.integrations.fanuc.language.in_place import write_fanuc_in_place
from counterflex.integrations.fanuc.language.program import FanucProgram, frame_of, wpr_of
from counterflex.integrations.fanuc.language.read.reader import read_fanuc, read_fanuc_file
from fanuc_listings import DOWN, cell, entry, listing
from robot_corrections import corrected, gap_to_polyline

EXAMPLE = Path(__file__).parents[2] / "examples" / "programs" / "groove.ls"
_TOLERANCE_M = 5.0 * UM


def points_of(text: str) -> list[tuple[str, list[list[float]], float, np.ndarray]]:
    """Motions read in another way: entries by one pattern over the whole file, rotations by scipy."""
    where = {
        int(m[1]): [float(v) for v in re.findall(r"[XYZWPR]\s*=\s*([-\d.E+]+)\s*(?:mm|deg)", m[2])]
        for m in re.finditer(r"P\[(\d+)[^\]]*\]\{(.*?)\};", text, re.DOTALL)
    }
    main = text.split("/MN")[1].split("/POS")[0]
    out = []
    for statement in main.split(";"):
        code = re.sub(r"(?m)^\s*\d*:", " ", statement).strip()
        if not re.match(r"[JLC]\s+P\[", code):
            continue
        named = [where[int(n)] for n in re.findall(r"P\[(\d+)", code)]
        speed = re.search(r"([\d.]+)(mm/sec|cm/min|%)", code)
        assert speed is not None
        mm_s = float(speed[1]) * {"mm/sec": 1.0, "cm/min": 10.0 / 60.0, "%": 0.0}[speed[2]]
        w, p, r = named[-1][3:]
        R = Rotation.from_euler("z", r, True) * Rotation.from_euler("y", p, True) * Rotation.from_euler("x", w, True)
        out.append((code[0], [one[:3] for one in named], mm_s, R.as_matrix()))
    return out


OTHERS = ("!remark L P[1]", "", "DO[7]=ON", "WAIT    .50(sec)", "R[1]=5", "IF (R[1]>2) THEN", "PAYLOAD[1]")


@st.composite
def listings(draw: st.DrawFn) -> str:
    """Straight motions and circles with whatever else stands between, some positions named twice."""
    statements, entries, count = ["UFRAME_NUM=1", "UTOOL_NUM=1", "J P[1] 20% FINE"], [entry(1, 0, 0, 90)], 1

    def position() -> str:
        nonlocal count
        if count > 1 and draw(st.integers(0, 5)) == 0:
            return f"P[{draw(st.integers(2, count))}]"
        count += 1
        x, y, z = (draw(st.integers(-30_000, 30_000)) / 1000.0 for _ in range(3))
        wpr = draw(st.sampled_from([DOWN, DOWN, (170.0, 5.0, 180.0), (-180.0, 0.0, -180.0)]))
        entries.append(entry(count, x, y, z, wpr))
        return f"P[{count}:p]"

    for _ in range(draw(st.integers(1, 6))):
        for other in draw(st.lists(st.sampled_from(OTHERS), max_size=2)):
            statements += [other, "ENDIF"] if "THEN" in other else [other]
        speed = draw(st.sampled_from(["50mm/sec", "150cm/min", "33.5mm/sec"]))
        end = draw(st.sampled_from(["FINE", "CNT100", "CNT0 ACC50"]))
        statements.append(f"L {position()} {speed} {end}")
    text = listing(*statements, entries="".join(entries))
    return text.replace("\n", draw(st.sampled_from(["\n", "\r\n"])))


def skeleton(text: str) -> str:
    """The text without numbers."""
    return re.sub(r"[-+]?\d+\.?\d*", "#", re.sub(r"P\[(\d+):\w+\]", r"P[\1]", text))


@settings(max_examples=40, deadline=None)
@given(listings(), st.floats(0.0, 800.0), st.floats(0.0, 30.0), st.sampled_from([0.0, 0.002]))
def test_only_positions_and_speeds_change(source: str, size_um: float, waves: float, turn: float) -> None:
    """Another reader finds the same motions; corrected, lines and entries stay in order but for numbers."""
    program = read_fanuc(source, name="part.ls")
    for motion, R, (word, points, mm_s, R_other) in zip(
        (m for m in program.motions if m.kind != "dwell"),
        (R for R, m in zip(program.Rs_part_tcp, program.motions, strict=True) if m.kind != "dwell"),  # type: ignore[arg-type]
        points_of(source.replace("\r\n", "\n")), strict=True,
    ):  # fmt: skip
        assert (motion.kind == "rapid") == (word == "J")
        np.testing.assert_allclose(motion.p_end / MM, points[-1], atol=1e-9)
        np.testing.assert_allclose(motion.feed_m_s * 1e3, mm_s if word != "J" else 0.0, rtol=1e-12)
        np.testing.assert_allclose(R, R_other, atol=1e-12)
    if any(np.any(np.asarray(motion.abc_end) != 0.0) for motion in program.motions):
        return
    compensated = corrected(program, size_um * UM, waves, turn)
    text = write_fanuc_in_place(program, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)
    after = text.files["part.ls"]
    if not compensated.moved.any() and not compensated.turned.any():
        assert after == source
        return
    if "\r\n" in source:
        assert "\n" not in after.replace("\r\n", "")
    rest = iter(skeleton(after).splitlines())
    for line in skeleton(source).splitlines():
        assert any(line == other for other in rest), line
    back = read_fanuc(after, name="part.ls")
    assert text.largest_written_error_m <= _TOLERANCE_M + 0.1 * UM
    assert len(back.motions) == len(program.motions) + text.vertices_added
    ends = np.array([motion.p_end for motion in back.motions])
    fed = np.array([motion.kind == "feed" for motion in program.motions])[compensated.path.motion]
    assert gap_to_polyline(compensated.p_part_command[fed], ends) < _TOLERANCE_M + 0.1 * UM


@pytest.mark.parametrize("speed", ["3.0sec", "1500MSEC", "50mm/sec"])
def test_pieces_of_a_motion_with_a_time_take_that_time_together(speed: str) -> None:
    """A piece with the time of the whole would run as many times more slowly as there are pieces."""
    source = listing("J P[1] 20% FINE", f"L P[2] {speed} FINE", entries=entry(1, 0, 0, 50) + entry(2, 90, 0, 50))
    program = read_fanuc(source, name="part.ls")
    text = write_fanuc_in_place(program, corrected(program, 300 * UM, 9.0), tolerance_m=_TOLERANCE_M, cycle_s=1e-3)
    back = read_fanuc(text.files["part.ls"], name="part.ls")
    assert text.vertices_added > 2
    duration_s = [sum(one.length_m / one.feed_m_s for one in made.motions[1:]) for made in (program, back)]
    assert duration_s[1] == pytest.approx(duration_s[0], rel=0.01)


@settings(max_examples=60, deadline=None)
@given(st.tuples(*(st.floats(-180.0, 180.0) for _ in range(3))))
def test_wpr_turns_about_fixed_axes(wpr: tuple[float, float, float]) -> None:
    """W about x, then P about y, then R about z, all fixed; written angles give the same orientation back."""
    w, p, r = (angle * DEG for angle in wpr)
    T = frame_of(dict(zip("XYZWPR", (0.0, 0.0, 0.0, *wpr), strict=True)))
    turned = rotation.about_z(r) @ (rotation.about_y(p) @ (rotation.about_x(w) @ np.eye(3)))
    np.testing.assert_allclose(T[:3, :3], turned, atol=1e-12)
    again = frame_of(dict(zip("XYZWPR", (0.0, 0.0, 0.0, *wpr_of(T[:3, :3])), strict=True)))
    np.testing.assert_allclose(again, T, atol=1e-9)


def test_a_circle_and_a_chain_of_single_points_are_the_same() -> None:
    """A half circle about (20, 0) by C, and by A through four points of it."""
    corners = [(10 - 10 * math.cos(a), 10 * math.sin(a)) for a in (0.0, 1.0, 2.0, math.pi)]
    entries = "".join(entry(n, 10 + x, y, 0.0) for n, (x, y) in enumerate(corners, start=1))
    by_c = read_fanuc(listing("L P[1] 20mm/sec FINE", "C P[2]\n    :  P[4] 20mm/sec FINE", entries=entries))
    by_a = read_fanuc(listing("J P[1] 5% FINE", *(f"A P[{n}] 20mm/sec CNT100" for n in (1, 2, 3, 4)), entries=entries))
    assert [motion.kind for motion in by_a.motions] == ["rapid", "feed", "arc", "arc", "arc"]
    arcs = by_a.motions[2:]
    assert by_c.motions[1].turn_rad == pytest.approx(sum(arc.turn_rad for arc in arcs), abs=2e-4)
    centre = by_c.motions[1].p_centre
    assert centre is not None
    for arc in arcs:
        assert arc.p_centre is not None
        np.testing.assert_allclose(arc.p_centre, centre, atol=1e-6)


def test_a_corrected_circle_stays_one() -> None:
    entries = entry(1, 10, 0, 0) + entry(2, 20, 10, 0) + entry(3, 30, 0, 0)
    program = read_fanuc(listing("J P[1] 5% FINE", "C P[2]\n    :  P[3] 20mm/sec FINE", entries=entries))
    compensated = corrected(program, 0.0, 0.0)
    moved = compensated.p_part_command.copy()
    angle = np.linspace(0.0, 1.0, len(moved))[:, None]
    moved += np.where(angle > 0.0, 200.0 * UM * np.sin(3.0 * np.pi * angle) * [0.0, 0.0, 1.0], 0.0)
    bent = dataclasses.replace(compensated, p_part_command=moved)
    text = write_fanuc_in_place(program, bent, tolerance_m=500.0 * UM)
    assert text.arcs_kept == 1
    back = read_fanuc(text.files["program.ls"])
    assert [motion.kind for motion in back.motions] == ["rapid", "arc"]
    text = write_fanuc_in_place(program, bent, tolerance_m=5.0 * UM)
    assert text.arcs_as_lines == 1
    assert " C P" not in text.files["program.ls"]


def test_process_words_frames_and_tools_by_the_cell() -> None:
    made = read_fanuc(
        listing("CALL TOOLCHG( 4 )", "UFRAME_NUM=1", "UTOOL_NUM=1", "J P[1] 20% FINE", "GO[1]=12000",
                "DO[1:spindle]=ON", "L P[2] 20mm/sec FINE", "DO[9]=ON", "DO[1:spindle]=OFF", "PAUSE", "END",
                "JMP LBL[3]",
                entries=entry(1, 0, 0, 50) + entry(2, 0, 0, 10)),
        cell=cell(),
    )  # fmt: skip
    assert [motion.tool for motion in made.motions] == [4, 4]
    np.testing.assert_allclose([m.spindle_rad_s for m in made.motions], [0.0, 12000 * RPM])
    words = [(word.letter, word.value) for block in made.blocks for word in block.words if word.letter in "MST"]
    assert words == [("M", 6.0), ("T", 4.0), ("M", 3.0), ("S", 12000.0), ("M", 5.0), ("M", 0.0)]
    assert made.acting == (12,)


P12 = entry(1, 0, 0, 50) + entry(2, 1, 0, 50)
BAD = {
    "PR[1] in the controller": (listing("L PR[1] 20mm/sec FINE"), r"part.ls:5:6.*where a motion goes is not known"),
    "a register as speed": (listing("L P[1] R[1]mm/sec FINE", entries=P12), r"speed of a motion is not known"),
    "turn by time": (listing("L P[1] 2deg/sec FINE", entries=P12), r"no speed along the path"),
    "an offset": (listing("L P[1] 20mm/sec FINE Offset,PR[1]", entries=P12), r"Offset is not known: PR\[1\]"),
    "a jump": (listing("JMP LBL[1]", entries=P12), r"no LBL\[1\]"),
    "a call": (listing("CALL OTHER", entries=P12), r"another program is called"),
    "a motion in IF": (listing("IF (R[1]=1) THEN", "L P[1] 20mm/sec FINE", "ENDIF", entries=P12), r"inside IF .line 5"),
    "override": (listing("OVERRIDE=R[3]%", "L P[1] 9mm/sec FINE", entries=P12), r"override is not known: R\[3\]"),
    "not taught": (listing(entries=P12.replace("X =     1.000", "X = ********")), r"never taught"),
    "missing position": (listing("L P[9] 20mm/sec FINE", entries=P12), r"where P\[9\] is, is not known"),
    "twice": (listing(entries=P12 + P12), r"P\[1\] is there twice"),
    "no end": (listing(entries=P12).replace("/END\n", ""), r"no /END"),
    "no semicolon": (listing("L P[1] 20mm/sec FINE", entries=P12).replace("FINE ;", "FINE"), r"without its semicolon"),
    "spline": (listing("S P[1] 20mm/sec FINE", entries=P12), r"spline"),
    "unknown": (listing("FOLD P[1]", entries=P12), r"unknown statement"),
    "another frame": (listing("UFRAME_NUM=2", "L P[1] 20mm/sec FINE", entries=P12), r"another frame"),
    "two groups": (listing("L P[1] 20mm/sec FINE", "L P[2] 20mm/sec FINE", entries=P12.replace(
        "\n};", "\n   GP2:\n\tUF : 1, UT : 1,\n\tJ1= 0.0 deg\n};", 1).replace(
        "deg\n};\n", "deg\n   GP2:\n\tUF : 1, UT : 1,\n\tJ1= 5.0 deg\n};\n").replace(
        "J1= 0.0 deg\n   GP2:\n\tUF : 1, UT : 1,\n\tJ1= 5.0 deg", "J1= 0.0 deg")), r"more than one group"),
    "bent chain": (listing("A P[1] 9mm/sec FINE", "A P[2] 9mm/sec FINE", entries=P12), r"shorter than three"),
    "empty": ("\n\n", r"empty"),
    "g-code": ("G1 X1\n", r"does not begin with /PROG"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_is_not_known_is_refused_with_its_line(name: str) -> None:
    text, match = BAD[name]
    with pytest.raises(ProgramError, match=match) as caught:
        read_fanuc(text, name="part.ls", cell=cell())
    assert "\n" not in str(caught.value)


def test_the_example_is_the_groove() -> None:
    program = read_fanuc_file(EXAMPLE)
    assert isinstance(program, FanucProgram)
    assert [motion.kind for motion in program.motions] == ["rapid", "feed", "feed", "feed", "feed"]
    assert program.motions[3].feed_m_s == pytest.approx(0.025)
    assert program.acting == (30,)
