"""Written G-code, judged by reading it back, and by LinuxCNC's interpreter where it is at hand."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import INCH, MM
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.programs.compensated import CompensatedPath, tool_path
from counterflex.programs.gcode.read import reader as gcode_reader
from counterflex.programs.gcode.read.parameter_file import MillingMachine
from counterflex.programs.gcode.write.writer import write_gcode
from counterflex.programs.machine_in_place import GcodeText
from counterflex.programs.program import Motion, Program

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data" / "writer"
RS274 = ROOT / ".tools" / "rs274"
PROGRAMS = sorted(path.name for path in DATA.glob("*.ngc"))
TOLERANCE = 5e-6
LENGTHS_M = {1: 0.0, 2: 0.0125, 3: 0.08025, 7: 0.033}  # those of tools/make_rs274_golden.py
ROUNDING = 4e-7  # m: start, end and centre each rounded to 0.1 um (0.25 um in inch)


def read_gcode(text: str, name: str = "program") -> Program:
    return gcode_reader.read_gcode(text, name=name, machine=MillingMachine(tool_lengths=LENGTHS_M))


def source(name: str) -> str:
    with (DATA / name).open(encoding="ascii", newline="") as stream:
        return stream.read()


def read(name: str, step_m: float = 1e-3) -> tuple[Program, ToolPath]:
    program = read_gcode(source(name), name=name)
    return program, tool_path(program, step_m=step_m)


def smooth(path: ToolPath, size_m: float = 2e-4) -> Float:
    x = path.p_part_tcp
    shift = size_m * np.stack(
        [np.sin(30 * x[:, 0] + 1), np.cos(20 * x[:, 1]), np.sin(17 * x[:, 0] + 20 * x[:, 2])], axis=1
    )
    shift[0] = 0.0
    out: Float = shift
    return out


def corrected(path: ToolPath, which: str, size_m: float = 2e-4) -> CompensatedPath:
    shift = smooth(path, size_m)
    if which != "all":
        shift[path.kind != FEED] = 0.0
    if which == "every third":
        shift[path.motion % 3 != 1] = 0.0
    return CompensatedPath.from_correction(path, shift)


def feed_rows(path: ToolPath) -> Int:
    out: Int = np.flatnonzero((path.kind == FEED) & (path.feed_m_s > 0.0))
    return out


def distance(points: Float, polyline: Float) -> Float:
    """Distance of points from a polyline."""
    a, d = polyline[:-1], np.diff(polyline, axis=0)
    length2 = np.maximum(np.sum(d * d, axis=1), 1e-30)
    out = np.empty(len(points))
    for k, q in enumerate(points):
        t = np.clip(np.sum((q - a) * d, axis=1) / length2, 0.0, 1.0)
        out[k] = np.sqrt(np.min(np.sum((a + t[:, None] * d - q) ** 2, axis=1)))
    return out


@pytest.mark.parametrize("name", PROGRAMS)
def test_no_correction_gives_the_source_byte_for_byte(name: str) -> None:
    program, path = read(name)
    result = write_gcode(program, CompensatedPath.nominal(path))
    assert result.text == source(name)
    assert result.moved_motions == 0


@pytest.mark.by_turn
@pytest.mark.parametrize("which", ["all", "feeds", "every third"])
@pytest.mark.parametrize("name", PROGRAMS)
def test_read_back_runs_through_every_commanded_point(name: str, which: str) -> None:
    program, path = read(name)
    compensated = corrected(path, which)
    result = write_gcode(program, compensated, tolerance_m=TOLERANCE)
    back = tool_path(read_gcode(result.text, name=name), step_m=5e-3, chord_m=5e-8)
    rows = feed_rows(path)
    off = distance(compensated.p_part_command[rows], back.p_part_tcp)
    assert off.max() <= TOLERANCE + ROUNDING
    assert result.largest_written_error_m <= TOLERANCE + ROUNDING
    assert result.largest_written_error_m >= off.max() - 1e-7
    assert back.p_part_tcp[-1] == pytest.approx(compensated.p_part_command[-1], abs=ROUNDING)


@pytest.mark.parametrize("name", PROGRAMS)
def test_feed_spindle_and_tool_survive(name: str) -> None:
    program, path = read(name)
    result = write_gcode(program, corrected(path, "feeds"))
    back = read_gcode(result.text, name=name)
    feeds = np.array(sorted({m.feed_m_s for m in program.motions if m.kind in ("feed", "arc")}))
    modes = {block.modal.feed_mode for block in program.blocks}
    if 93 not in modes:
        written = np.array([m.feed_m_s for m in back.motions if m.kind in ("feed", "arc")])
        factor = written[:, None] / feeds
        assert np.all(np.any((factor > 0.4999) & (factor < 2.0001), axis=1))
        still = write_gcode(program, CompensatedPath.nominal(path))
        again = read_gcode(still.text, name=name)
        assert sorted({m.feed_m_s for m in again.motions if m.kind in ("feed", "arc")}) == feeds.tolist()
    assert {m.spindle_rad_s for m in back.motions} == {m.spindle_rad_s for m in program.motions}
    assert {m.tool for m in back.motions} == {m.tool for m in program.motions}
    assert sum(m.duration_s for m in back.motions) == pytest.approx(sum(m.duration_s for m in program.motions))
    if program.straight:
        comments = re.findall(r"\([^)]*\)", "\n".join(program.lines))
        assert [c for c in re.findall(r"\([^)]*\)", result.text) if c in comments] == comments


def test_the_tool_keeps_its_feed_relative_to_the_part() -> None:
    """A correction that grows along a cut makes the commanded way longer: the time it takes must not grow."""
    text = "G21 G90\nG0 X0 Y0 Z0\nG1 X10 F1500\nX20\nG2 X30 Y0 I5 J0\nG1 X40\nF900\nX50\nG0 Z5\nG1 X60 F600\nM2\n"
    program = read_gcode(text)
    path = tool_path(program)
    shift = np.zeros((len(path), 3))
    x = path.p_part_tcp[:, 0]
    shift[:, 1] = 1.5e-3 * np.clip((x - 4e-3) / 3e-3, 0.0, 1.0)
    shift[(x > 20.1e-3) | (path.kind != FEED)] = 0.0
    back = read_gcode(write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text)

    def seconds(motions: Sequence[Motion], low: float, high: float) -> float:
        return sum(
            float(np.linalg.norm(np.asarray(m.p_end) - np.asarray(m.p_start))) / m.feed_m_s
            for m in motions
            if m.kind == "feed" and low <= m.p_start[0] < high - 1e-9
        )

    assert seconds(back.motions, 0.0, 0.02) == pytest.approx(0.02 / 0.025, rel=0.01)
    plain = sum(float(np.linalg.norm(np.asarray(m.p_end) - np.asarray(m.p_start))) for m in back.motions[1:-1])
    assert plain > 0.0505
    after = [m for m in back.motions if m.kind in ("feed", "arc") and m.p_start[0] > 0.0195]
    nominal = [m for m in program.motions if m.kind in ("feed", "arc") and m.p_start[0] > 0.0195]
    assert {(m.kind, m.feed_m_s) for m in after} == {(m.kind, m.feed_m_s) for m in nominal}


def linuxcnc_ends(text: str, folder: Path) -> Float:
    """End points in m of the motions that LinuxCNC's interpreter makes of a program without offsets."""
    spec = importlib.util.spec_from_file_location("make_rs274_golden", ROOT / "tools" / "make_rs274_golden.py")
    assert spec is not None
    assert spec.loader is not None
    judge = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(judge)
    program = folder / "program.ngc"
    program.write_text(text, encoding="ascii", newline="")
    ends: list[list[float]] = []
    plane, unit = (0, 1, 2), MM
    here = [0.0, 0.0, 0.0]
    for call in judge.canonical_calls(program):
        name, arguments = call.rstrip(")").split("(", 1)
        if name == "SELECT_PLANE":
            plane = {"CANON_PLANE_XY": (0, 1, 2), "CANON_PLANE_XZ": (2, 0, 1), "CANON_PLANE_YZ": (1, 2, 0)}[arguments]
        elif name == "USE_LENGTH_UNITS":
            unit = INCH if "INCH" in arguments else MM
        elif name in ("STRAIGHT_FEED", "STRAIGHT_TRAVERSE", "ARC_FEED"):
            numbers = [unit * float(v) for v in arguments.split(",")]
            here = list(here)
            if name == "ARC_FEED":
                for axis, value in zip(plane, (numbers[0], numbers[1], numbers[5]), strict=True):
                    here[axis] = value
            else:
                here = numbers[:3]
            ends.append(here)
    return np.array(ends)


@pytest.mark.parametrize("which", ["all", "feeds", "every third"])
@pytest.mark.parametrize("name", PROGRAMS)
def test_motions_end_where_commanded(name: str, which: str, tmp_path: Path) -> None:
    program, path = read(name)
    compensated = corrected(path, which)
    result = write_gcode(program, compensated)
    back = read_gcode(result.text, name=name)
    ends = np.array([m.p_end for m in back.motions if m.kind != "dwell"])
    moving = np.array([m.kind != "dwell" for m in program.motions])[path.motion]
    last = {int(m): row for row, m in enumerate(path.motion) if moving[row]}
    at = 0
    for row in last.values():
        near = np.abs(ends[at:] - compensated.p_part_command[row]).max(axis=1) < ROUNDING
        assert near.any(), f"motion {path.motion[row]} never reaches its commanded end"
        at += int(np.argmax(near))
    if RS274.exists() and name not in ("offsets.ngc", "tool_length.ngc"):
        judged = linuxcnc_ends(result.text, tmp_path)
        printed = 3e-6 if name == "inch.ngc" else 2e-7  # its four decimals, in inch or mm
        assert distance(judged, ends).max() < printed
        assert distance(ends, judged).max() < printed


def test_lines_of_uncorrected_motions_stay() -> None:
    program, path = read("fc_grooves_pocket.ngc")
    shift = smooth(path)
    chosen = 21  # one arc of the pocket's spiral or one groove: whatever motion this is, the rest must stay
    shift[path.motion != chosen] = 0.0
    result = write_gcode(program, CompensatedPath.from_correction(path, shift))
    written = result.text.split("\n")
    kept = [line for line in program.lines if line in written]
    assert len(program.lines) - len(kept) <= 2  # its own line and the one that inherits its end
    assert result.completed_blocks <= 1
    assert result.moved_motions == 1


def shifted(path: ToolPath, shift: tuple[float, float, float]) -> CompensatedPath:
    correction = np.tile(np.array(shift), (len(path), 1))
    correction[0] = 0.0
    return CompensatedPath.from_correction(path, correction)


@pytest.mark.parametrize("name", ["planes.ngc", "helix.ngc", "modal_arcs.ngc", "fc_profile.ngc", "inch.ngc"])
def test_a_shifted_arc_stays_one_arc(name: str) -> None:
    program, path = read(name)
    result = write_gcode(program, shifted(path, (1.23e-4, -2.34e-4, 3.45e-4)))
    arcs = [m for m in program.motions if m.kind == "arc"]
    back = [m for m in read_gcode(result.text).motions if m.kind == "arc"]
    assert result.arcs_split == result.arcs_as_lines == 0
    assert result.arcs_kept == len(arcs) == len(back)
    for old, new in zip(arcs, back, strict=True):
        assert new.p_centre is not None
        assert old.p_centre is not None
        assert new.turn_rad == pytest.approx(old.turn_rad, rel=1e-4)
        assert new.p_centre - old.p_centre == pytest.approx(np.array([1.23e-4, -2.34e-4, 3.45e-4]), abs=2e-6)


def test_a_wider_arc_stays_one_arc_and_a_wavy_one_is_split_within_tolerance() -> None:
    program = read_gcode("G21 G90\nG0 X40 Y0 Z5\nG1 Z0 F900\nG3 X0 Y40 I-40 F900\nG0 Z9\nM2\n")
    path = tool_path(program, step_m=1e-3)
    radial = path.p_part_tcp / np.maximum(np.linalg.norm(path.p_part_tcp[:, :2], axis=1), 1e-9)[:, None]
    radial[:, 2] = 0.0
    arc = path.motion == 2
    shift = np.where((path.motion >= 1)[:, None] & (path.kind == FEED)[:, None], 3e-4 * radial, 0.0)
    wider = write_gcode(program, CompensatedPath.from_correction(path, shift))
    assert (wider.arcs_kept, wider.arcs_split) == (1, 0)
    assert "G3 X0.0000 Y40.3000 I-40.3000 J0.0000 F900" in wider.text
    angle = np.arctan2(path.p_part_tcp[:, 1], path.p_part_tcp[:, 0])
    wavy = np.where(arc[:, None], 1e-4 * np.sin(8.0 * angle)[:, None] * radial, 0.0)
    split = write_gcode(program, CompensatedPath.from_correction(path, wavy))
    assert (split.arcs_kept, split.arcs_split) == (0, 1)
    assert split.largest_written_error_m <= TOLERANCE + ROUNDING
    lines = [line for line in split.text.split("\n") if line.startswith("G3")]
    assert 2 <= len(lines) <= 16


def test_following_modal_blocks_keep_their_meaning_behind_a_split_arc() -> None:
    program = read_gcode("G21 G90\nG0 X0 Y0 Z0\nG2 X10 Y10 I10 J0 F500\nX20 Y0 I0 J-10\nG1 X30\nM2\n")
    path = tool_path(program, step_m=1e-4)
    rough = np.random.default_rng(3).normal(0.0, 2e-5, (len(path), 3))
    rough[path.motion != 1] = rough[np.flatnonzero(path.motion == 1)[-1]] = 0.0
    result = write_gcode(program, CompensatedPath.from_correction(path, rough))
    assert result.arcs_as_lines == 1
    back = read_gcode(result.text)
    arcs = [m for m in back.motions if m.kind == "arc"]
    assert len(arcs) == 1
    assert arcs[0].p_end == pytest.approx([0.02, 0.0, 0.0], abs=ROUNDING)
    assert arcs[0].turn_rad == pytest.approx(-0.5 * np.pi, abs=1e-2)


def test_inherited_words_are_added_and_counted() -> None:
    text = "G21 G90\nG0 X0 Y0 Z5\nG1 X10 F500\nG0 Z9\nG0 X20 Y0 Z9\nM2\n"
    program = read_gcode(text)
    path = tool_path(program)
    shift = np.zeros((len(path), 3))
    shift[path.motion == 1] = [0.0, 1e-4, 0.0]
    result = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False, tolerance_m=1.0)
    assert result.text.split("\n") == [
        "G21 G90",
        "G0 X0 Y0 Z5",
        "G1 X10 Y0.1000 F500",
        "G0 Y0.0000 Z9",
        "G0 X20 Y0 Z9",
        "M2",
        "",
    ]
    assert (result.moved_motions, result.completed_blocks, result.split_motions) == (1, 1, 0)


def test_incremental_programs_do_not_add_up_roundings() -> None:
    text = "G21 G90\nG0 X0 Y0 Z0\nG91\n" + "G1 X0.1 Y0.03 F900\n" * 1000 + "M2\n"
    program = read_gcode(text)
    path = tool_path(program)
    rng = np.random.default_rng(0)
    shift = rng.normal(0.0, 3e-5, (len(path), 3))
    shift[path.motion == 0] = 0.0
    compensated = CompensatedPath.from_correction(path, shift)
    result = write_gcode(program, compensated, decimals=3)
    ends = np.array([m.p_end for m in read_gcode(result.text).motions])
    last = np.flatnonzero(np.diff(path.motion, append=-1))
    assert np.abs(ends - compensated.p_part_command[last]).max() <= 0.5e-6 * 1.001


def test_inverse_time_is_divided() -> None:
    program = read_gcode("G21 G90 G93\nG0 X0 Y0 Z0\nG1 X60 F2\nM2\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.zeros((len(path), 3))
    shift[:, 1] = 1e-4 * np.sin(100.0 * path.p_part_tcp[:, 0])
    shift[path.motion == 0] = 0.0
    result = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False)
    feeds = [float(f) for f in re.findall(r"F([\d.]+)", result.text)]
    assert len(feeds) == 1 + result.vertices_added > 2
    assert sum(1.0 / f for f in feeds) == pytest.approx(0.5, rel=1e-5)


def test_inverse_time_of_uneven_pieces_is_that_of_their_lengths() -> None:
    """A correction near the start only: short pieces there, a long one behind, all at the speed of the block."""
    program = read_gcode("G21 G90 G93\nG0 X0 Y0 Z0\nG1 X60 F2\nM2\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.zeros((len(path), 3))
    shift[:, 1] = 1e-4 * np.sin(200.0 * path.p_part_tcp[:, 0]) * (path.p_part_tcp[:, 0] < 0.0157)
    shift[path.motion == 0] = 0.0
    result = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False)
    times = 1.0 / np.array([float(f) for f in re.findall(r"F([\d.]+)", result.text)])
    ends = np.array([m.p_end[0] for m in read_gcode(result.text).motions])[-len(times) :]
    ways = np.diff(ends, prepend=0.0)
    assert ways.max() > 3.0 * ways.min()
    np.testing.assert_allclose(times, 0.5 * ways / 0.06, rtol=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_inverse_time_of_a_split_arc_is_divided_by_the_turn(side: float) -> None:
    """Pieces of an arc take the times of their shares of it: the sum is the block's time, each as long as its way."""
    program = read_gcode("G21 G90 G93\nG0 X0 Y0 Z0\nG2 X40 Y0 I20 J0 F4\nM2\n")
    path = tool_path(program, step_m=2e-4)
    along = path.p_part_tcp[:, 0] / 0.04
    shift = np.zeros((len(path), 3))
    shift[:, 1] = side * 3e-4 * np.sin(9.0 * along) * np.clip(2.0 * along, 0.0, 1.0)
    shift[path.motion == 0] = 0.0
    result = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False)
    assert result.vertices_added >= 1
    again = read_gcode(result.text)
    feeds = [float(f) for f in re.findall(r"F([\d.]+)", result.text)]
    assert sum(1.0 / f for f in feeds) == pytest.approx(0.25, rel=1e-4)
    pieces = [m for m in again.motions if np.linalg.norm(np.subtract(m.p_end, m.p_start)) > 0.0]
    assert len(pieces) == len(feeds)
    ways = []
    for motion in pieces:
        chord = float(np.linalg.norm(np.subtract(motion.p_end, motion.p_start)))
        turn = abs(motion.turn_rad)
        ways.append(chord * (0.5 * turn / np.sin(0.5 * turn)) if turn > 0.0 else chord)
    times = 1.0 / np.array(feeds)
    np.testing.assert_allclose(times / times.sum(), np.array(ways) / sum(ways), rtol=0.05)


def test_a_stop_in_a_split_block_still_comes_last() -> None:
    program = read_gcode("G21 G90\nG0 X0 Y0 Z0\nN7 G1 X60 F900 M0 (look)\nG0 Z5\nM2\n")
    path = tool_path(program, step_m=1e-3)
    shift = np.zeros((len(path), 3))
    shift[:, 1] = 1e-4 * np.sin(100.0 * path.p_part_tcp[:, 0])
    shift[path.motion != 1] = 0.0
    lines = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text.split("\n")
    stop = lines.index("M0")
    assert lines[2].startswith("N7 G1 X")
    assert lines[2].endswith("F900 (look)")
    assert all(line.startswith("G1 X") and "N7" not in line for line in lines[3:stop])
    assert lines[stop + 1] == "G0 Y0.0000 Z5"


@pytest.mark.parametrize("stop", ["M0", "M1", "M30"])
def test_a_stop_in_a_cycle_that_is_written_out_comes_behind_the_hole(stop: str) -> None:
    program = read_gcode(f"G21 G90\nG0 X0 Y0 Z10\nG98 G81 X10 Y10 Z-5 R2 F200\nX30 {stop}\n" + "M2\n" * (stop != "M30"))
    path = tool_path(program, step_m=1e-3)
    shift = np.zeros((len(path), 3))
    shift[path.motion > 0, 1] = 1e-4
    lines = write_gcode(program, CompensatedPath.from_correction(path, shift), header=False).text.split("\n")
    holes = [k for k, line in enumerate(lines) if "Z-5." in line]
    assert len(holes) == 2
    assert holes[1] < lines.index(stop)
    assert lines[lines.index(stop) - 1].startswith("G0 Z10")


def test_loops_are_written_out() -> None:
    program, path = read("loop.ngc")
    result = write_gcode(program, corrected(path, "feeds"))
    assert result.unrolled
    assert "written out" in result.text
    code = re.sub(r"\([^)]*\)", "", result.text)
    assert not re.search(r"[oO]\d|#|\[", code)
    assert result.text.count("(pass)") == 4
    assert result.text.count("M8") == 4


def test_header_names_source_tolerance_and_cell() -> None:
    program, path = read("inch.ngc")
    result = write_gcode(program, corrected(path, "all"), cell="KR 300 (cell 2)", tolerance_m=2e-6)
    lines = result.text.split("\n")
    assert lines[0] == "%"
    assert "counterflex" in lines[1]
    assert "inch.ngc" in lines[1]
    assert "0.0020 mm" in lines[2]
    assert "KR 300 cell 2" in lines[2]


def test_expressions_on_the_current_position_are_fixed() -> None:
    program, path = read("params.ngc")
    result = write_gcode(program, corrected(path, "feeds"))
    ends = np.array([m.p_end for m in read_gcode(result.text).motions])
    assert ends[-1] == pytest.approx([0.07, 0.06, 0.05], abs=ROUNDING)


def test_dropped_rotation_is_reported() -> None:
    program, path = read("crlf.ngc")
    turn = np.zeros((len(path), 3))
    turn[-1] = [3e-4, 0.0, 4e-4]
    result = write_gcode(program, CompensatedPath.from_correction(path, np.zeros((len(path), 3)), turn))
    assert result.largest_dropped_rotation_rad == pytest.approx(5e-4)
    assert result.text == source("crlf.ngc")


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(1e-8, 1e-3), tolerance=st.floats(5e-7, 5e-5))
def test_straight_moves_hold_the_tolerance_at_the_same_place(seed: int, size: float, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    corners = np.round(rng.uniform(-50.0, 50.0, (6, 3)), 3)
    text = "G21 G90\nG0 X0 Y0 Z0\n" + "".join(f"G1 X{x:.3f} Y{y:.3f} Z{z:.3f} F900\n" for x, y, z in corners)
    program = read_gcode(text)
    path = tool_path(program, step_m=2e-3)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    shift = size * np.stack([np.sin(s * f + g) for f, g in rng.uniform(1.0, 60.0, (3, 2))], axis=1)
    shift[path.motion == 0] = 0.0
    compensated = CompensatedPath.from_correction(path, shift)
    result = write_gcode(program, compensated, tolerance_m=tolerance)
    back = read_gcode(result.text)
    ends = np.array([m.p_end for m in back.motions])
    # Written vertices are samples: find each in order, and interpolate between them over the nominal length.
    at = [0]
    for end in ends[1:]:
        near = np.linalg.norm(compensated.p_part_command[at[-1] + 1 :] - end, axis=1)
        at.append(at[-1] + 1 + int(np.argmax(near < 2e-7)))
    at_row = [int(np.flatnonzero(path.motion == 0)[-1]), *at[1:]]
    polyline = np.vstack([ends[0], ends[1:]])
    rows = np.arange(at_row[0], len(path))
    written = np.stack([np.interp(s[rows], s[at_row], polyline[:, c]) for c in range(3)], axis=1)
    gap = np.linalg.norm(written - compensated.p_part_command[rows], axis=1)
    assert gap.max() <= tolerance + 1e-7
    assert result.largest_written_error_m == pytest.approx(gap.max(), abs=1e-10)


def test_refusals() -> None:
    program, path = read("inch.ngc")
    other = tool_path(read_gcode("G21 G90\nG0 X0 Y0 Z0\nG1 X60 F2\nM2\n"))
    with pytest.raises(InputError, match="not sampled from this program"):
        write_gcode(program, CompensatedPath.nominal(other))
    with pytest.raises(InputError, match="decimals"):
        write_gcode(program, CompensatedPath.nominal(path), decimals=9)
    with pytest.raises(InputError, match="tolerance_m"):
        write_gcode(program, CompensatedPath.nominal(path), tolerance_m=-1.0)
    with pytest.raises(InputError, match="shape"):
        CompensatedPath(path, path.p_part_tcp[1:], path.p_part_tcp)
    with pytest.raises(InputError, match="finite"):
        CompensatedPath.from_correction(path, np.full((len(path), 3), np.nan))


def test_many_short_moves_are_edited_in_place() -> None:
    x = np.arange(1, 3001) * 0.5
    text = "G21 G90\nG0 X0 Y0 Z0\n" + "".join(f"G1 X{v:.4f} Y{np.sin(v):.4f} Z-1.0000 F1500.0000 \n" for v in x)
    program = read_gcode(text + "M2\n")
    path = tool_path(program)
    result: GcodeText = write_gcode(program, corrected(path, "feeds"), header=False)
    assert result.moved_motions == 3000
    assert len(result.text.split("\n")) == len(program.lines) + result.vertices_added
    assert result.vertices_added <= 1
