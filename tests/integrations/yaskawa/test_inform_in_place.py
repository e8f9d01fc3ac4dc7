"""INFORM jobs: read as another reader reads them, written back with only positions and speeds changed."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.integrations.yaskawa.language.in_place import write_inform_in_place
from counterflex.integrations.yaskawa.language.program import angles_of, frame_of
from counterflex.integrations.yaskawa.language.reader import read_inform
from counterflex.programs.compensated import CompensatedPath
from inform_jobs import DOWN, job, point, points
from robot_corrections import corrected, gap_to_polyline

_TOLERANCE_M = 5.0 * UM
_LAST_DIGIT_M = 1.0 * UM


def motions_of(text: str) -> list[tuple[str, list[float], float, np.ndarray]]:
    """Motions read in another way: one pattern for the entries, rotations by scipy."""
    where = {m[1]: [float(v) for v in m[2].split(",")] for m in re.finditer(r"(?m)^([CP]\d+)=(.*?)\r?$", text)}
    out = []
    for match in re.finditer(r"(?m)^\s*(MOV[JL]) ([CP]\d+)(?: VJ?=([\d.]+))?", text):
        values = where[match[2] if match[2][0] == "C" else f"P{int(match[2][1:]):05d}"]
        R = Rotation.from_euler("xyz", values[3:], degrees=True).as_matrix()
        out.append((match[1], values[:3], float(match[3]) if match[1] == "MOVL" else 0.0, R))
    return out


OTHERS = ("'remark MOVL C00000", "", "DOUT OT#(7) ON", "TIMER T=0.50", "SET B005 5", 'MSG "here"', "*L{}", "REFP 1")


@st.composite
def jobs(draw: st.DrawFn) -> str:
    """Straight motions with whatever else stands between, some positions named twice, some by variables."""
    entries, lines, count = [point("C", 0, (0, 0, 90))], ["MOVJ C00000 VJ=10.00"], 1
    by_variable: list[str] = []
    for _ in range(draw(st.integers(1, 6))):
        for k, other in enumerate(draw(st.lists(st.sampled_from(OTHERS), max_size=2))):
            lines.append(other.format(f"{len(lines)}{k}"))
        if count > 1 and draw(st.integers(0, 5)) == 0:
            name = f"C{draw(st.integers(1, count - 1)):05d}"
        else:
            place = tuple(draw(st.integers(-30_000, 30_000)) / 1000.0 for _ in range(3))
            turn = draw(st.sampled_from([DOWN, DOWN, (170.0, 5.0, 180.0), (-180.0, 0.0, -180.0)]))
            if draw(st.integers(0, 4)) == 0:
                name = f"P{len(by_variable) + 10:03d}"
                by_variable.append(point("P", len(by_variable) + 10, place, turn))
            else:
                name = f"C{count:05d}"
                entries.append(point("C", count, place, turn))
                count += 1
        speed, level = (
            draw(st.sampled_from(["50.0", "25", "33.5"])),
            draw(st.sampled_from(["", " PL=0", " PL=3 ACC=50"])),
        )
        lines.append(f"MOVL {name} V={speed}{level}")
    return job(*lines, entries=[*entries, *by_variable]).replace("\n", draw(st.sampled_from(["\n", "\r\n"])))


def skeleton(text: str) -> str:
    """The text without numbers."""
    return re.sub(r"[-+]?\d+\.?\d*", "#", re.sub(r"MOVL P\d+", "MOVL C0", text))


@settings(max_examples=60, deadline=None)
@given(jobs(), st.floats(0.0, 800.0), st.floats(0.0, 30.0), st.sampled_from([0.0, 0.002]))
def test_only_positions_and_speeds_change(source: str, size_um: float, waves: float, turn: float) -> None:
    """Another reader finds the same motions; corrected, lines and entries stay in order but for numbers."""
    program = read_inform(source, name="part.jbi")
    moves = [(m, R) for m, R in zip(program.motions, program.Rs_part_tcp, strict=True) if m.kind != "dwell"]  # type: ignore[arg-type]
    for (motion, R), (word, place, mm_s, R_other) in zip(moves, motions_of(source), strict=True):
        assert (motion.kind == "rapid") == (word == "MOVJ")
        np.testing.assert_allclose(motion.p_end / MM, place, atol=1e-9)
        np.testing.assert_allclose(motion.feed_m_s * 1e3, mm_s, rtol=1e-12)
        np.testing.assert_allclose(R, R_other, atol=1e-12)
    if any(np.any(np.asarray(motion.abc_end) != 0.0) for motion in program.motions):
        return
    compensated = corrected(program, size_um * UM, waves, turn)
    text = write_inform_in_place(program, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)
    after = text.files["part.jbi"]
    if not compensated.moved.any() and not compensated.turned.any():
        assert after == source
        return
    if "\r\n" in source:
        assert "\n" not in after.replace("\r\n", "")
    rest = iter(skeleton(after).splitlines())
    for line in skeleton(source).splitlines():
        assert any(line == other for other in rest), line
    names = re.findall(r"(?m)^C(\d+)=", after)
    assert [int(name) for name in names] == list(range(len(names)))
    assert f"///NPOS {len(names)},0," in after
    back = read_inform(after, name="part.jbi")
    assert text.largest_written_error_m <= _TOLERANCE_M + _LAST_DIGIT_M
    assert len(back.motions) == len(program.motions) + text.vertices_added
    ends = np.array([motion.p_end for motion in back.motions])
    fed = np.array([motion.kind == "feed" for motion in program.motions])[compensated.path.motion]
    assert gap_to_polyline(compensated.p_part_command[fed], ends) < _TOLERANCE_M + _LAST_DIGIT_M


@settings(max_examples=80, deadline=None)
@given(st.tuples(*(st.floats(-180.0, 180.0) for _ in range(3))))
def test_angles_turn_about_fixed_axes(angles: tuple[float, float, float]) -> None:
    """Rx, then Ry, then Rz about fixed axes, as scipy has it; written angles give the same orientation back."""
    T = frame_of((1.0, 2.0, 3.0, *angles))
    np.testing.assert_allclose(T[:3, :3], Rotation.from_euler("xyz", angles, degrees=True).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(T[:3, 3], [1e-3, 2e-3, 3e-3])
    np.testing.assert_allclose(frame_of((1.0, 2.0, 3.0, *angles_of(T[:3, :3]))), T, atol=1e-8)


ARCS = points((0, 0, 50), (0, 0, 0), (0, 0, 0), (10, 10, 0), (20, 0, 0), (30, -10, 0), (40, 0, 0), (40, 0, 50))
ROW = ("MOVJ C00000 VJ=10.00", "MOVL C00001 V=25.0", "MOVC C00002 V=20.0", "MOVC C00003 V=20.0",
       "MOVC C00004 V=20.0 FPT", "{}", "MOVC C00005 V=20.0", "MOVC C00006 V=20.0", "MOVL C00007 V=50.0")  # fmt: skip


def bent(source: str, size_m: float, motions: tuple[int, ...]) -> tuple[object, CompensatedPath]:
    """A correction that swings along some motions and is 0 at their ends."""
    program = read_inform(source, name="part.jbi")
    plain = corrected(program, 0.0, 0.0)
    path = plain.path
    correction = np.zeros((len(path), 3))
    for index in motions:
        rows = np.flatnonzero(path.motion == index)
        correction[rows, 2] = size_m * np.sin(np.pi * np.arange(1, len(rows) + 1) / len(rows) * 2.0)
    return program, CompensatedPath.from_correction(path, correction, np.zeros((len(path), 3)))


@pytest.mark.parametrize("between", ["'remark", "DOUT OT#(3) ON", "TIMER T=0.20"])
@pytest.mark.parametrize("corrected_arcs", [(2,), (3,), (2, 3)])
def test_an_arc_that_becomes_lines_leaves_the_other_one_an_arc(between: str, corrected_arcs: tuple[int, ...]) -> None:
    """Two half circles joined at FPT, a dwell or an output between; what is read back is what was commanded."""
    source = job(*(line.format(between) for line in ROW), entries=ARCS)
    dwell = between.startswith("TIMER")
    shifted = tuple(index + (dwell and index == 3) for index in corrected_arcs)
    program, compensated = bent(source, 300.0 * UM, shifted)
    kinds = [motion.kind for motion in program.motions]  # type: ignore[attr-defined]
    assert kinds == ["rapid", "feed", "arc", *(["dwell"] if dwell else []), "arc", "feed"]
    text = write_inform_in_place(program, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)  # type: ignore[arg-type]
    assert text.arcs_as_lines == len(corrected_arcs)
    back = read_inform(text.files["part.jbi"], name="part.jbi")
    assert sum(motion.kind == "arc" for motion in back.motions) == 2 - len(corrected_arcs)
    assert between in text.files["part.jbi"]
    path = compensated.path
    for index in shifted:
        ends = np.array([motion.p_end for motion in back.motions])
        assert gap_to_polyline(compensated.p_part_command[path.motion == index], ends) < _TOLERANCE_M + _LAST_DIGIT_M
    np.testing.assert_allclose(back.motions[-1].p_end, program.motions[-1].p_end, atol=1e-9)  # type: ignore[attr-defined,arg-type]


def test_a_shifted_circle_stays_a_circle() -> None:
    """All points of both arcs move by the same; the MOVC at the start of the first one follows the MOVL before it."""
    source = job(*(line.format("'remark") for line in ROW), entries=ARCS)
    program = read_inform(source, name="part.jbi")
    plain = corrected(program, 0.0, 0.0)
    shift = np.where(np.isin(plain.path.motion, (1, 2, 3))[:, None], [50.0 * UM, -30.0 * UM, 20.0 * UM], 0.0)
    moved = CompensatedPath.from_correction(plain.path, shift, np.zeros_like(shift))
    text = write_inform_in_place(program, moved, tolerance_m=_TOLERANCE_M, cycle_s=1e-4)
    assert (text.arcs_kept, text.arcs_as_lines) == (2, 0)
    back = read_inform(text.files["part.jbi"], name="part.jbi")
    arcs = [motion for motion in back.motions if motion.kind == "arc"]
    assert len(arcs) == 2
    for arc, old in zip(arcs, program.motions[2:4], strict=True):
        assert arc.p_centre is not None
        assert old.p_centre is not None
        np.testing.assert_allclose(arc.p_centre, old.p_centre + shift[plain.path.motion == 2][0], atol=2.0 * UM)
        assert arc.turn_rad == pytest.approx(old.turn_rad, abs=1e-3)


def test_an_increment_and_a_variable_are_written_out() -> None:
    lines = ("MOVJ C00000 VJ=10.00", "MOVL P010 V=20.0", "IMOV P011 V=20.0 UF#(1)", "IMOV P011 V=20.0 UF#(1)")
    entries = [*points((0, 0, 0)), point("P", 10, (10, 0, 0)), point("P", 11, (0, 5, 0), (0.0, 0.0, 0.0))]
    program = read_inform(job(*lines, entries=entries), name="part.jbi")
    np.testing.assert_allclose(
        [m.p_end for m in program.motions], np.array([[0, 0, 0], [10, 0, 0], [10, 5, 0], [10, 10, 0]]) * MM
    )
    compensated = corrected(program, 300.0 * UM, 0.0)
    text = write_inform_in_place(program, compensated, tolerance_m=_TOLERANCE_M, cycle_s=1.0)
    after = text.files["part.jbi"]
    assert "IMOV" not in after
    assert "P00010=10.000" in after  # other jobs use it too
    back = read_inform(after, name="part.jbi")
    np.testing.assert_allclose(back.motions[-1].p_end, compensated.p_part_command[-1], atol=_LAST_DIGIT_M)


def test_a_loop_cannot_hold_two_corrections() -> None:
    lines = ("SET B000 0", "*A", "MOVL C00000 V=20.0", "MOVL C00001 V=20.0", "INC B000", "JUMP *A IF B000<2")
    program = read_inform(job(*lines, entries=points((0, 0, 0), (10, 0, 0))), name="part.jbi")
    assert len(program.motions) == 4
    with pytest.raises(ProgramError, match=r"part.jbi:\d+:1.*runs more than once") as caught:
        write_inform_in_place(program, corrected(program, 300.0 * UM, 0.0))
    assert caught.value.data["each_pass"] is True
