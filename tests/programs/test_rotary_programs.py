"""Programs that turn the tool: poses from their words, words that do not fit, and the way back."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.geometry import rotation
from counterflex.path.toolpath import FEED
from counterflex.path.turning import TurnedPath
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.gcode.read.reader import read_gcode
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.program import Program
from counterflex.programs.rotary.fitted import fitted, turns
from counterflex.programs.rotary.machine import RotaryAxis, RotaryMachine
from counterflex.programs.rotary.poses import CommandedWords, RotaryWords, turned_path

X, Y, Z = np.eye(3)
TRUNNION = RotaryMachine(
    (RotaryAxis("A", "table", X, np.array([0.0, 0.0, -0.08]), (-0.6, 2.1)), RotaryAxis("C", "table", Z, 0.02 * X))
)
MIXED = RotaryMachine((RotaryAxis("C", "table", Z, 0.03 * Y), RotaryAxis("B", "head", Y, 0.25 * Z)))
FORK = RotaryMachine((RotaryAxis("C", "head", Z), RotaryAxis("B", "head", Y, 0.25 * Z)))
MACHINES = {"table-table": (TRUNNION, "A"), "head-table": (MIXED, "B"), "head-head": (FORK, "B")}
HEAD = "G21 G17 G90 G94\nM6 T1\nM3 S9000\n"


def sampled(text: str, machine: RotaryMachine | None, step_m: float = 1e-3) -> tuple[Program, RotaryWords, TurnedPath]:
    read = read_gcode(text, name="five.ngc")
    assert turns(read)
    program = fitted(read, machine)
    words = RotaryWords.of(program, machine)
    return program, words, turned_path(program, words, step_m=step_m, rapid_speed_m_s=0.25)


def test_the_tip_runs_straight_at_the_programmed_feed_under_g43_4() -> None:
    text = HEAD + "G0 A20 C10\nG43.4 H1\nG0 X0 Y0 Z5\nG1 X30 A40 C-20 F600\nM2\n"
    _, _, turned = sampled(text, TRUNNION)
    path, last = turned.path, turned.path.kind == FEED
    np.testing.assert_allclose(path.p_part_tcp[last, 1:], [[0.0, 0.005]] * last.sum(), atol=1e-12)
    np.testing.assert_allclose(path.feed_m_s[last], 0.01, rtol=1e-9)
    share = path.p_part_tcp[last, 0] / 0.03
    np.testing.assert_allclose(turned.angle_rad[last, 0], np.deg2rad(20.0 + 20.0 * share), atol=1e-12)
    np.testing.assert_allclose(path.axis_part, TRUNNION.tool_axis(turned.angle_rad), atol=1e-12)
    steps = np.arccos(np.clip(np.sum(path.axis_part[1:] * path.axis_part[:-1], axis=1), -1.0, 1.0))
    assert np.rad2deg(steps.max()) < 0.5


def test_without_tool_centre_a_turning_table_draws_an_arc_in_the_part() -> None:
    """C alone, at rest in XYZ: the tip circles the axis of the table at its distance, the other way round."""
    text = HEAD + "G0 X50 Y0 Z10 A0 C0\nG93 G1 C90 F60\nM2\n"
    table = RotaryMachine((RotaryAxis("A", "table", X), RotaryAxis("C", "table", Z)))
    _, _, turned = sampled(text, table)
    path, cut = turned.path, turned.path.kind == FEED
    np.testing.assert_allclose(np.linalg.norm(path.p_part_tcp[cut, :2], axis=1), 0.05, rtol=1e-12)
    np.testing.assert_allclose(path.p_part_tcp[-1], [0.0, -0.05, 0.01], atol=1e-12)
    np.testing.assert_allclose(path.feed_m_s[cut], 0.05 * np.pi / 2.0, rtol=1e-3)
    assert path.time_s[-1] - path.time_s[~cut][-1] == pytest.approx(1.0)


def test_tool_vectors_are_directions_of_any_length() -> None:
    text = HEAD + "G43.5 H1\nG0 X0 Y0 Z20 I0 J0 K2\nG1 X10 I0.3 K0.4 F300\nG1 X20 F300\nM2\n"
    _, _, turned = sampled(text, None)
    path = turned.path
    np.testing.assert_allclose(path.axis_part[-1], [0.6, 0.0, 0.8], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(path.axis_part, axis=1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(
        path.axis_part[path.motion == path.motion[-1]], path.axis_part[-1:].repeat(10, axis=0)
    )


def test_the_tool_stands_still_where_its_centre_begins_to_be_programmed() -> None:
    """G43.4 with the axes turned moves nothing; the next motion starts where the tool is."""
    text = HEAD + "G0 X10 Y20 Z90 A30 C40\nG43.4 H1\nG0 X0 Y0 Z60\nM2\n"
    _, _, turned = sampled(text, TRUNNION)
    before = TRUNNION.tip(np.array([[0.01, 0.02, 0.09]]), np.deg2rad([[30.0, 0.0, 40.0]]), np.array([False]))[0]
    first = int(np.argmax(turned.path.motion == 1))
    np.testing.assert_allclose(turned.path.p_part_tcp[first - 1], before, atol=1e-12)
    np.testing.assert_allclose(turned.path.p_part_tcp[first], before, atol=1e-12)
    assert np.linalg.norm(turned.path.p_part_tcp[first + 1 :] - before, axis=1).min() > 1e-3


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("G0 X0 Y0 Z0\nG1 X10 B5 F100", ("five.ngc:5:8", "no rotary axis B", "B5", "A C (table-table", "posted for")),
        ("G0 A130", ("five.ngc:4:4", "beyond its limits", "A130", "-34.3775 to 120.321", "cannot be reached")),
        ("G91 G0 A10", ("five.ngc:4:8", "G91", "A10", "G90")),
        ("G0 A10\nG92 A0\nG0 A5", ("five.ngc:6:4", "shifts a rotary axis", "A5 means 15 deg", "zero")),
        ("G0 A10 X0 Y0 Z0\nG2 X10 I5 F100", ("five.ngc:5:1", "arc", "straight moves")),
        ("G0 A10 C0 X0 Y0 Z0\nG1 C5 F100", ("five.ngc:5:4", "only turns", "G93")),
        ("G0 X1 Y2 Z90 A10\nG43.4 H1\nG0 Z50", ("five.ngc:6:4", "does not name Y", "Name X, Y and Z")),
        ("G43.5 H1\nG0 X0 Y0 Z9 I1 J0 K0\nG49\nG0 A10", ("five.ngc:7", "G43.5 ends with the tool tilted", "K1")),
    ],
)
def test_words_that_do_not_fit_are_named(body: str, expected: tuple[str, ...]) -> None:
    with pytest.raises(ProgramError) as fault:
        sampled(HEAD + body + "\nM2\n", TRUNNION)
    for piece in expected:
        assert piece in str(fault.value)


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("G43.5 H1\nG0 I0 J0 K0", ("five.ngc:5:4", "no length")),
        ("G43.5 H1\nG0 X0 I0 J0 K1 A5", ("five.ngc:5:16", "under G43.5", "G43.4")),
        ("G43.5 H1 G91\nG0 X0 I0 J0 K1", ("five.ngc:5:7", "G91")),
        ("G0 X0 I0 J0 K1", ("five.ngc:4:7", "nothing in this block uses the word I")),
    ],
)
def test_tool_vectors_that_mean_nothing(body: str, expected: tuple[str, ...]) -> None:
    with pytest.raises(ProgramError) as fault:
        sampled(HEAD + body + "\nM2\n", None)
    for piece in expected:
        assert piece in str(fault.value)


def _bent(turned: TurnedPath, rng: np.random.Generator) -> tuple[Float, Float]:
    """Smooth corrections of tip and direction, as a plan makes them: zero in the rapids."""
    n, phase = len(turned.path), rng.uniform(0.0, 6.0, 6)
    wave = np.sin(np.linspace(0.0, 7.0, n)[:, None] + phase)
    on = (turned.path.kind == FEED)[:, None]
    return np.where(on, 0.4e-3 * wave[:, :3], 0.0), np.where(on, 0.8e-3 * wave[:, 3:], 0.0)


MODES = ("", "G43.4 H1\n", "G43.5 H1\n")


@pytest.mark.parametrize("mode", MODES, ids=["machine", "centre", "vector"])
@pytest.mark.parametrize("name", MACHINES)
def test_corrected_poses_come_back_from_the_written_words(name: str, mode: str) -> None:
    """Tilted and simultaneous motion: what is read back is the commanded tip and direction, within the tolerance."""
    machine, tilt = MACHINES[name]
    if "G43.5" in mode:
        turn = ("I0.3 J0.1 K0.9", "I0.4 J0.1 K0.9", "")
    else:
        turn = (f"{tilt}20 C30", f"{tilt}28 C24", "")
    text = HEAD + mode + f"G0 X5 Y-4 Z60 {turn[0]}\nG1 Z20 F900\nG1 X35 {turn[1]} F600\nG1 Y20 {turn[2]}\nG0 Z60\nM2\n"
    program, words, turned = sampled(text, machine)
    correction, rotvec = _bent(turned, np.random.default_rng(3))
    asked = CommandedWords.of(turned, words, correction, rotvec)
    assert asked.dropped_rad < 1e-9
    tolerance = 5e-6
    result = write_gcode(program, CompensatedPath.nominal(turned.programmed), words=asked, tolerance_m=tolerance)
    assert result.moved_motions == 3
    back = fitted(read_gcode(result.text), machine)
    back_words = RotaryWords.of(back, machine)
    read = turned_path(back, back_words, step_m=1e-4, rapid_speed_m_s=0.25)
    p = turned.path.p_part_tcp + correction
    axis = np.einsum("nij,nj->ni", rotation.exp(rotvec), turned.path.axis_part)
    feed = np.flatnonzero(turned.path.kind == FEED)[3::7]
    near = np.linalg.norm(read.path.p_part_tcp[None] - p[feed, None], axis=2)
    row = near.argmin(axis=1)
    assert float(near.min(axis=1).max()) < 1e-4  # half a step along the path, and the tolerance
    step = read.path.p_part_tcp[np.minimum(row + 1, len(read.path) - 1)] - read.path.p_part_tcp[row - 1]
    turn = read.path.axis_part[np.minimum(row + 1, len(read.path) - 1)] - read.path.axis_part[row - 1]
    share = np.sum((p[feed] - read.path.p_part_tcp[row]) * step, axis=1) / np.sum(step * step, axis=1)
    across = p[feed] - read.path.p_part_tcp[row] - share[:, None] * step
    assert float(np.linalg.norm(across, axis=1).max()) < 2.0 * tolerance
    leaning = axis[feed] - read.path.axis_part[row] - share[:, None] * turn
    assert float(np.linalg.norm(leaning, axis=1).max()) < 2.0 * tolerance / 0.3


def test_a_program_without_corrections_stays_as_it_is() -> None:
    text = HEAD + "G43.4 H1\nG0 X5 Y-4 Z60 A20 C30\nG1 Z20 F900\nG1 X35 A28 F600\nG0 Z60 A0\nM2\n"
    program, words, turned = sampled(text, TRUNNION)
    none = np.zeros((len(turned.path), 3))
    asked = CommandedWords.of(turned, words, none, none)
    assert write_gcode(program, CompensatedPath.nominal(turned.programmed), words=asked).text == text


def test_at_a_singular_position_the_direction_that_cannot_be_said_is_told() -> None:
    """With the tool along C only the tip and one direction are corrected; the rest is reported, the tip is exact."""
    text = HEAD + "G43.4 H1\nG0 X5 Y-4 Z60 B0.5 C0\nG0 B0\nG1 Z20 F900\nG1 X35 F600\nM2\n"
    program, words, turned = sampled(text, FORK)
    correction, rotvec = _bent(turned, np.random.default_rng(4))
    asked = CommandedWords.of(turned, words, correction, rotvec)
    assert 0.3e-3 < asked.dropped_rad < 1.0e-3
    tip, _ = words.pose(asked.p_command, asked.angle_command_rad, turned.path.motion)
    np.testing.assert_allclose(tip, turned.path.p_part_tcp + correction, atol=1e-12)
    np.testing.assert_array_equal(asked.angle_command_rad[:, 2], asked.angle_rad[:, 2])
    result = write_gcode(program, CompensatedPath.nominal(turned.programmed), words=asked)
    assert result.largest_dropped_rotation_rad == asked.dropped_rad


def test_a_block_that_stays_one_turns_at_its_end_and_the_retract_turns_back() -> None:
    text = HEAD + "G43.4 H1\nG0 X5 Y-4 Z60 A20 C30\nG0 Z21\nG1 Z20 F900\nG1 X35 F600\nG0 Z60\nM2\n"
    program, words, turned = sampled(text, TRUNNION)
    fed = turned.path.kind == FEED
    first = int(np.argmax(fed))
    share = np.clip((np.arange(len(fed)) - first + 1) / 1.0, 0.0, 1.0) * fed
    rotvec = share[:, None] * np.array([1e-3, 0.0, 0.0])
    asked = CommandedWords.of(turned, words, np.zeros_like(rotvec), rotvec)
    back = read_gcode(write_gcode(program, CompensatedPath.nominal(turned.programmed), words=asked).text)
    ends = [motion.abc_end for motion in back.motions]
    assert len(ends) == 5
    np.testing.assert_allclose(ends[3], asked.angle_command_rad[fed][-1], atol=2e-7)
    assert abs(ends[3][0] - np.deg2rad(20.0)) > 1e-4
    np.testing.assert_allclose(ends[4], np.deg2rad([20.0, 0.0, 30.0]), atol=1e-12)
