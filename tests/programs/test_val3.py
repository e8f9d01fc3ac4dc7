"""VAL3 programs with their data file: another reader reads the same; written back, only points and speeds change."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG, MM, RPM, UM
from counterflex.geometry import rotation
from counterflex.integrations.staubli.language.in_place import write_val3_in_place
from counterflex.integrations.staubli.language.program import LETTERS, frame_of, rotations_of
from counterflex.integrations.staubli.language.read.reader import read_val3, read_val3_file
from robot_corrections import corrected, gap_to_polyline
from val3_files import DOWN, at, cell, data, program

EXAMPLE = Path(__file__).parents[2] / "examples" / "programs" / "groove.pgx"
_TOLERANCE_M = 5.0 * UM


def points_of(text: str, file: str) -> list[tuple[str, list[float], float, np.ndarray]]:
    """Motions read in another way: an XML parser, rotations by scipy."""
    root = ET.fromstring(file.replace("xsi:", "xsi_"))  # of our own text
    values = {(d.get("name"), int(v.get("key", "0"))): v.attrib for d in root.iter("Data") for v in d.iter("Value")}
    out = []
    for line in text.splitlines():
        code = line.split("//")[0].strip()
        match = re.fullmatch(r"(?:\w+=)?(move[jl])\(p\[(\d+)\],\w+\[0\],mRun\[(\d+)\]\)", code)
        if match is None:
            continue
        point, speed = values["p", int(match[2])], values["mRun", int(match[3])]
        xyz = [float(point.get(letter, "0")) for letter in "xyz"]
        R = Rotation.from_euler("XYZ", [float(point.get(letter, "0")) for letter in ("rx", "ry", "rz")], degrees=True)
        out.append((match[1], xyz, float(speed.get("tmax", "inf")), R.as_matrix()))
    return out


OTHERS = ("// movel(p[0],tMill[0],mRun[0])", "", "dioX=true", "waitEndMove()", 'putln("movel")', "nA=nA+1")


@st.composite
def programs(draw: st.DrawFn) -> tuple[str, str]:
    """Straight motions with whatever else stands between, some points named twice, attributes left out."""
    lines, points = ["nTraj=movej(p[0],tMill[0],mRun[0])"], [at(0, 0, 90)]
    for _ in range(draw(st.integers(1, 6))):
        for other in draw(st.lists(st.sampled_from(OTHERS), max_size=2)):
            lines += [other]
        if len(points) > 1 and draw(st.integers(0, 5)) == 0:
            number = draw(st.integers(1, len(points) - 1))
        else:
            number = len(points)
            x, y, z = (draw(st.integers(-30_000, 30_000)) / 1000.0 for _ in range(3))
            more = draw(st.sampled_from([DOWN, DOWN, 'rx="180" rz="180" fatherId="fPart[0]"']))
            points.append(at(x, y, z, more) if draw(st.booleans()) else f'x="{x}" {more}')
        before = draw(st.sampled_from(["", "nTraj="]))
        lines.append(f"{before}movel(p[{number}],tMill[0],mRun[{draw(st.integers(0, 1))}])")
    newline = draw(st.sampled_from(["\n", "\r\n"]))
    return program(*lines).replace("\n", newline), data(points).replace("\n", newline)


def skeleton(text: str) -> str:
    """The text without numbers, and without angles and coordinates that may be added."""
    return re.sub(r'\s*\b(x|y|z|rx|ry|rz)="#"', "", re.sub(r"-?\d+\.?\d*", "#", text))


def lines_stay(before: str, after: str, replaced: str) -> None:
    """Every line of a text stands in the other one in order, but for numbers."""
    rest = iter(skeleton(after).splitlines())
    for line in skeleton(before).splitlines():
        assert any(line == other or re.sub(replaced, "", line) == re.sub(replaced, "", other) for other in rest), line


@settings(max_examples=40, deadline=None)
@given(programs(), st.floats(0.0, 800.0), st.floats(0.0, 30.0), st.sampled_from([0.0, 0.002]))
def test_only_points_and_speeds_change(files: tuple[str, str], size_um: float, waves: float, turn: float) -> None:
    text, listed = files
    made = read_val3(text, data=listed)
    assert made.Rs_part_tcp is not None
    for motion, R, (word, xyz, mm_s, R_other) in zip(
        made.motions, made.Rs_part_tcp, points_of(text, listed), strict=True
    ):
        assert (motion.kind == "rapid") == (word == "movej")
        np.testing.assert_allclose(motion.p_end / MM, xyz, atol=1e-9)
        np.testing.assert_allclose(motion.feed_m_s * 1e3, 0.0 if word == "movej" else mm_s)
        np.testing.assert_allclose(R, R_other, atol=1e-12)
    compensated = corrected(made, size_um * UM, waves, turn)
    out = write_val3_in_place(made, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)
    if not compensated.moved.any() and not compensated.turned.any():
        assert out.files == {"program.pgx": text, "program.dtx": listed}
        return
    after, data_after = out.files["program.pgx"], out.files["program.dtx"]
    lines_stay(text, after, r"(p|pCounterflex|mRun|mCounterflex)\[#\]")
    lines_stay(listed, data_after, r"$^")
    if "\r\n" in text:
        assert "\n" not in (after + data_after).replace("\r\n", "")
    ET.fromstring(data_after.replace("xsi:", "xsi_"))
    back = read_val3(after, data=data_after)
    assert len(back.motions) == len(made.motions) + out.vertices_added
    assert out.largest_written_error_m <= _TOLERANCE_M + 0.1 * UM
    ends = np.array([motion.p_end for motion in back.motions])
    fed = np.array([motion.kind == "feed" for motion in made.motions])[compensated.path.motion]
    assert gap_to_polyline(compensated.p_part_command[fed], ends) < _TOLERANCE_M + 0.1 * UM


@settings(max_examples=60, deadline=None)
@given(st.tuples(*(st.floats(-180.0, 180.0) for _ in range(3))))
def test_angles_turn_about_moved_axes(angles: tuple[float, float, float]) -> None:
    """Rx about x, then ry about the new y, then rz about the new z."""
    T = frame_of(dict(zip(LETTERS, (0.0, 0.0, 0.0, *angles), strict=True)))
    R = np.eye(3)
    for axis, angle in enumerate(angles):
        R = rotation.exp(angle * DEG * R[:, axis]) @ R
    np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
    again = frame_of(dict(zip(LETTERS, (0.0, 0.0, 0.0, *rotations_of(R)), strict=True)))
    np.testing.assert_allclose(again[:3, :3], R, atol=1e-9)


def test_circles_waits_and_process_words() -> None:
    """A half circle, a wait at rest (one on the way is none), the table read backwards."""
    made = read_val3(
        program("call change( 4 )", "movej(p[0],tMill,mRun[0])", "aioSpeed=9000", "dioSpindle = true // on",
                "movec(p[1],p[2],tMill[0],mRun[1])", "delay(2)", "waitEndMove()", "delay(0.5)", "dioSpindle=false",
                "open(tMill)", "get()"),
        data=data([at(10, 0, 0), at(20, 10, 0), at(30, 0, 0)]), cell=cell(),
    )  # fmt: skip
    assert [motion.kind for motion in made.motions] == ["rapid", "arc", "dwell"]
    assert abs(made.motions[1].turn_rad) == pytest.approx(np.pi)
    assert made.motions[2].duration_s == 0.5
    assert made.moves[1].exact
    assert [motion.tool for motion in made.motions] == [4, 4, 4]
    np.testing.assert_allclose(made.motions[1].spindle_rad_s, 9000 * RPM)
    words = [(word.letter, word.value) for block in made.blocks for word in block.words if word.letter in "MST"]
    assert words == [("M", 6.0), ("T", 4.0), ("M", 3.0), ("S", 9000.0), ("M", 5.0), ("M", 0.0)]
    assert made.acting == (14,)


TWO = [at(0, 0, 50), at(1, 0, 50)]
BAD = {
    "computed": (program("movel(appro(p[0],tA),tMill[0],mRun[0])"), data(TWO), r"tA is in no data file"),
    "a variable index": (program("movel(p[i],tMill[0],mRun[0])"), data(TWO), r"place of p\[i\].*i is in no data file"),
    "assigned": (program("p[0].trsf.x=nX", "movel(p[0],tMill[0],mRun[0])"), data(TWO), r"nX is in no data file"),
    "no such point": (program("movel(p[7],tMill[0],mRun[0])"), data(TWO), r"part.pgx:5:3.*place of p\[7\]"),
    "no data": (program("movel(p[0],tMill[0],mRun[0])"), "", r"not known"),
    "axes": (program("movel(jRest[0],tMill[0],mRun[0])"), data(TWO), r"axis angles"),
    "loop": (program("while true", "movel(p[0],tMill[0],mRun[0])", "endWhile"), data(TWO), r"repeats from line 5 on"),
    "call": (program("call other()"), data(TWO), r"subprogram"),
    "arguments": (program("movel(p[0],tMill[0])"), data(TWO), r"has 3 arguments"),
    "other frame": (program("movel(p[0],tMill[0],mRun[0])"), data(TWO).replace('rz="90"', 'rz="80"'), r"part frame"),
    "other tool": (program("movel(p[0],tMill[0],mRun[0])"), data(TWO).replace('z="100"', 'z="101"'), r"tip of tMill"),
    "unknown": (program("jump 5"), data(TWO), r"unknown statement"),
    "cut": (program().replace("end\n", ""), data(TWO), r"no end"),
    "cut file": (program().replace("</Program>", ""), data(TWO), r"cut off"),
    "cut data": (program(), data(TWO)[:200], r"no data file"),
    "no number": (program("movel(p[0],tMill[0],mRun[0])"), data(TWO).replace('x="0"', 'x="a"'), r"x is no number"),
    "project": ("<Project>\n</Project>\n", data(TWO), r"no program file"),
    "empty": ("", "", r"empty"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_is_not_known_is_refused_with_its_line(name: str) -> None:
    text, listed, match = BAD[name]
    with pytest.raises(ProgramError, match=match) as caught:
        read_val3(text, name="part.pgx", data=listed, data_name="part.dtx", cell=cell())
    assert "\n" not in str(caught.value)


def test_the_example_is_the_groove() -> None:
    made = read_val3_file(EXAMPLE)
    assert [motion.kind for motion in made.motions] == ["rapid", "feed", "feed", "feed", "feed"]
    assert made.motions[3].feed_m_s == pytest.approx(0.025)
    np.testing.assert_allclose(made.motions[4].p_end / MM, [72.0, 15.0, 60.0])
