"""Rotated, mirrored and polar coordinates against complex numbers, and what is written back of them."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.program import Program

HEAD = "G21 G90 G17\nT1 M6\nS1000 M3 F600\nG0 X0 Y0 Z5\n"
BODY = (
    "G0 X20 Y3\nG1 Z-1\nG1 X25 Y3\nG91\nG1 X2 Y1\nG90\nG2 X37 Y4 I5 J0\nG3 X37 Y4 I-2 J1 Z-2\nG3 X30 Y-3 R-9\nG0 Z5\n"
)
PLANES = {17: (0, 1), 18: (2, 0), 19: (1, 2)}


def read(text: str) -> Program:
    return read_gcode(text, name="part.nc")


def points(program: Program, first: int = 1) -> np.ndarray:
    return np.array([motion.p_end for motion in program.motions[first:]]) / MM


def in_plane(p: np.ndarray, plane: int) -> np.ndarray:
    a, b = PLANES[plane]
    return p[..., a] + 1j * p[..., b]


numbers = st.integers(-400, 400).map(lambda value: value / 10.0)


@settings(max_examples=40, deadline=None)
@given(numbers, numbers, st.integers(-3600, 3600).map(lambda value: value / 10.0))
def test_a_rotation_turns_points_and_centres_about_its_centre(x: float, y: float, angle: float) -> None:
    plain, turned = read(HEAD + BODY + "M2\n"), read(f"{HEAD}G68 X{x} Y{y} R{angle}\n{BODY}G69\nM2\n")
    factor, centre = cmath.exp(1j * math.radians(angle)), complex(x, y)
    truth = centre + factor * (in_plane(points(plain), 17) - centre)
    assert in_plane(points(turned), 17) == pytest.approx(truth, abs=1e-9)
    assert points(turned)[:, 2] == pytest.approx(points(plain)[:, 2], abs=0.0)
    for one, other in zip(plain.motions[1:], turned.motions[1:], strict=True):
        assert other.turn_rad == pytest.approx(one.turn_rad)
        assert other.feed_m_s == pytest.approx(one.feed_m_s)
        if one.p_centre is not None and other.p_centre is not None:
            away = in_plane(other.p_centre / MM, 17) - (centre + factor * (in_plane(one.p_centre / MM, 17) - centre))
            assert abs(away) < 1e-9
            assert other.normal == pytest.approx(one.normal)


@pytest.mark.parametrize("plane", [17, 18, 19])
def test_a_rotation_belongs_to_its_plane(plane: int) -> None:
    a, b = ("XYZ"[axis] for axis in PLANES[plane])
    program = read(f"G21 G90 G{plane}\nG0 X1 Y2 Z3\nG68 {a}0 {b}0 R90\nG0 {a}10 {b}0\nM2\n")
    assert in_plane(points(program)[-1], plane) == pytest.approx(10j)


@pytest.mark.parametrize(("axes", "sign"), [("X10", -1), ("Y-4", -1), ("X10 Y-4", 1)])
def test_a_mirror_image_turns_arcs_round(axes: str, sign: int) -> None:
    plain, mirrored = read(HEAD + BODY + "M2\n"), read(f"{HEAD}G51.1 {axes}\n{BODY}G50.1\nM2\n")
    truth = points(plain)
    for word in axes.split():
        axis = "XYZ".index(word[0])
        truth[:, axis] = 2.0 * float(word[1:]) - truth[:, axis]
    assert points(mirrored) == pytest.approx(truth, abs=1e-9)
    for one, other in zip(plain.motions[1:], mirrored.motions[1:], strict=True):
        assert other.turn_rad == pytest.approx(sign * one.turn_rad)
    # the middle of an arc is the mirror image of its middle: sampled paths agree
    first = [tool_path(program, step_m=1e-3).p_part_tcp[-1] for program in (plain, mirrored)]
    assert abs(first[0][2] - first[1][2]) < 1e-12


def test_the_rotation_turns_the_mirror_image() -> None:
    program = read(f"{HEAD}G51.1 X0\nG68 X0 Y0 R90\nG0 X10 Y2\nM2\n")
    assert in_plane(points(program)[-1], 17) == pytest.approx(1j * complex(-10, 2))
    with pytest.raises(ProgramError, match="the mirror image changes while G68 is active"):
        read(f"{HEAD}G68 X0 Y0 R90\nG51.1 X0\nM2\n")


@settings(max_examples=40, deadline=None)
@given(st.floats(0.1, 50.0).map(lambda r: round(r, 3)), st.integers(-720, 720), st.integers(-90, 90))
def test_polar_words_are_radius_and_angle(radius: float, angle: int, next_angle: int) -> None:
    program = read(f"{HEAD}G16\nG0 X{radius} Y{angle}\nG1 Y{next_angle}\nG15\nG0 X1\nM2\n")
    assert in_plane(points(program), 17)[:2] == pytest.approx(
        [cmath.rect(radius, math.radians(angle)), cmath.rect(radius, math.radians(next_angle))], abs=1e-9
    )
    assert points(program)[-1][0] == pytest.approx(1.0)


def test_a_pattern_of_holes_in_polar_words() -> None:
    program = read(f"{HEAD}G16\nG98 G81 X10 Y0 Z-3 R2\nY120\nY240\nG15 G80\nM2\n")
    bottoms = [point for point in points(program) if point[2] == -3.0]
    assert in_plane(np.array(bottoms), 17) == pytest.approx([10 * cmath.exp(2j * math.pi * k / 3) for k in range(3)])


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("G68 X0 Y0 R30\nG0 X1", "does not name X and Y in G90"),
        ("G68 X0 Y0 R30\nG91 G0 X1 Y1", "does not name X and Y in G90"),
        ("G68 X0 Y0 R30\nG0 X1 Y1\nG69\nG0 X1", "does not name X and Y in G90"),
        ("G51.1 X0\nG91 G1 X1", "does not name X in G90"),
        ("G68 X0 Y0", "G68 without R"),
        ("G68 X0 Y0 Z0 I0 J1 K0 R30", "a rotation G68 in space"),
        ("G68 X0 Y0 R30\nG18", "the plane changes while G68"),
        ("G16\nG91 G0 X1 Y5", "controllers differ in where they count from"),
        ("G16\nG0 Y5", "needs radius and angle"),
        ("G16\nG0 X5 Y0\nG2 X5 Y90 I-5 J0", "in polar coordinates .G16. has its centre"),
        ("G68 X0 Y0 R30\nG0 X0 Y0\nG92 X0", "G92 under G68"),
        ("G51 X0 Y0 P2", "the unit of its factor"),
        ("G68.2 X0 Y0 Z0 I0 J30 K0", "a tilted working plane"),
    ],
)
def test_what_controllers_do_not_agree_in_is_refused(line: str, match: str) -> None:
    with pytest.raises(ProgramError, match=match) as caught:
        read(f"{HEAD}{line}\nM2\n")
    assert caught.value.hint


@pytest.mark.parametrize("absolute", [False, True])
def test_a_rotated_program_is_written_back_in_its_own_words(absolute: bool) -> None:
    body = BODY.replace("I5 J0", "I32 J4").replace("I-2 J1", "I35 J5") if absolute else BODY
    mode = "G90.1\n" if absolute else ""
    program = read(f"{HEAD}{mode}G52 X3\nG68 X10 Y0 R30\n{body}G69\nG0 X0 Y0\nM2\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.where((path.kind == FEED)[:, None], [0.1 * MM, 0.2 * MM, 0.0], 0.0)
    commanded = CompensatedPath.from_correction(path, shift)
    written = write_gcode(program, commanded, tolerance_m=5e-6)
    assert "G68 X10 Y0 R30" in written.text
    again = read(written.text)
    centres = [m.p_centre for m in again.motions if m.p_centre is not None]
    moved = np.array([0.1 * MM, 0.2 * MM, 0.0])
    for motion in program.motions:
        if motion.kind not in ("feed", "arc"):
            continue
        goal = np.add(motion.p_end, moved)
        assert min(float(np.linalg.norm(m.p_end - goal)) for m in again.motions) < 2e-7
        if motion.p_centre is not None and abs(motion.turn_rad) < 6.0:
            middle = np.add(motion.p_centre, moved)
            assert min(float(np.linalg.norm((centre - middle)[:2])) for centre in centres) < 2e-5


@pytest.mark.parametrize("frame", ["G51.1 X10\nG0 X20 Y3\nG1 X22", "G16\nG0 X20 Y3\nG1 X22 Y3"])
def test_mirrored_and_polar_programs_are_not_written_back(frame: str) -> None:
    program = read(f"{HEAD}{frame}\nM2\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.where((path.feed_m_s > 0.0)[:, None], [0.0, 0.2 * MM, 0.0], 0.0)
    with pytest.raises(ProgramError, match="is not written back with other targets.*write another language"):
        write_gcode(program, CompensatedPath.from_correction(path, shift))
    assert write_gcode(program, CompensatedPath.nominal(path)).text == program.newline.join(program.lines)
