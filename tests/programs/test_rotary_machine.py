"""Rotary axes of a milling machine: closed forms of each type, composition by scipy, round trips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.programs.rotary.machine import SINGULAR, RotaryAxis, RotaryMachine

X, Y, Z = np.eye(3)
TRUNNION = RotaryMachine((RotaryAxis("A", "table", X), RotaryAxis("C", "table", Z)))
MIXED = RotaryMachine((RotaryAxis("B", "head", Y), RotaryAxis("C", "table", Z)))
FORK = RotaryMachine((RotaryAxis("C", "head", Z), RotaryAxis("B", "head", Y)))
MACHINES = {"table-table": TRUNNION, "head-table": MIXED, "head-head": FORK}
angles = st.floats(-3.0, 3.0)
lengths = st.floats(-0.5, 0.5)


def words(a: float = 0.0, b: float = 0.0, c: float = 0.0) -> Float:
    return np.array([[a, b, c]])


@pytest.mark.parametrize("name", MACHINES)
def test_the_type_is_named(name: str) -> None:
    assert MACHINES[name].kind == name


@given(tilt=angles, turn=angles)
def test_tool_axis_of_each_type(tilt: float, turn: float) -> None:
    """Closed forms of the three types, with the tilting axis next to the bed (table) or next to the tool (head)."""
    s, c = np.sin(tilt), np.cos(tilt)
    np.testing.assert_allclose(
        TRUNNION.tool_axis(words(a=tilt, c=turn))[0], [s * np.sin(turn), s * np.cos(turn), c], rtol=0.0, atol=1e-12
    )
    np.testing.assert_allclose(
        MIXED.tool_axis(words(b=tilt, c=turn))[0], [s * np.cos(turn), -s * np.sin(turn), c], rtol=0.0, atol=1e-12
    )
    np.testing.assert_allclose(
        FORK.tool_axis(words(b=tilt, c=turn))[0], [s * np.cos(turn), s * np.sin(turn), c], rtol=0.0, atol=1e-12
    )


def test_a_nutating_head_lays_the_tool_flat_at_half_a_turn() -> None:
    """About an axis at 45 deg a turn of 180 deg brings z to y: ``2 (u z) u - z``."""
    nutating = RotaryMachine((RotaryAxis("B", "head", np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)),))
    np.testing.assert_allclose(nutating.tool_axis(words(b=np.pi))[0], [0.0, 1.0, 0.0], atol=1e-15)


@given(tilt=angles, length=st.floats(0.05, 0.5))
def test_a_head_swings_the_tip_about_its_pivot(tilt: float, length: float) -> None:
    head = RotaryMachine((RotaryAxis("B", "head", Y, np.array([0.0, 0.0, length])),))
    tip = head.tip(np.zeros((1, 3)), words(b=tilt), np.array([False]))[0]
    np.testing.assert_allclose(tip, [-length * np.sin(tilt), 0.0, length - length * np.cos(tilt)], atol=1e-12)


def test_a_quarter_turn_of_the_table_about_an_axis_beside_the_part() -> None:
    """The part's point (p, 0, 0) stands at (c, p - c, 0) once the table about (c, 0, 0) has turned by 90 deg."""
    table = RotaryMachine((RotaryAxis("C", "table", Z, np.array([0.1, 0.0, 0.0])),))
    tip = table.tip(np.array([[0.1, 0.2, 0.05]]), words(c=np.pi / 2), np.array([False]))[0]
    np.testing.assert_allclose(tip, [0.3, 0.0, 0.05], atol=1e-15)


def _composed(machine: RotaryMachine, p: Float, angle: Float) -> tuple[Float, Float]:
    """Tip and tool axis in the part with scipy's rotations and homogeneous matrices."""
    T = {"table": np.eye(4), "head": np.eye(4)}
    for axis in machine.axes:
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(angle[axis.index] * axis.direction).as_matrix()
        step[:3, 3] = axis.p_pivot - step[:3, :3] @ axis.p_pivot
        T[axis.moves] = T[axis.moves] @ step
    tool = np.eye(4)
    tool[:3, 3] = p
    seen = np.linalg.inv(T["table"]) @ tool @ T["head"]
    return seen[:3, 3], seen[:3, 2]


@st.composite
def machines(draw: st.DrawFn) -> RotaryMachine:
    axes = []
    for letter in draw(st.sampled_from(["AB", "BC", "CA", "C", "B"])):
        raw = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(3)]) + 1.2 * np.eye(3)["ABC".index(letter)]
        pivot = np.array([draw(lengths) for _ in range(3)])
        side = draw(st.sampled_from(["table", "head"]))
        axes.append(RotaryAxis(letter, side, raw / np.linalg.norm(raw), pivot))  # type: ignore[arg-type]
    try:
        return RotaryMachine(tuple(axes))
    except InputError:
        return FORK


@settings(max_examples=60)
@given(machine=machines(), seed=st.integers(0, 10_000))
def test_any_machine_is_the_product_of_its_turns(machine: RotaryMachine, seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, angle = rng.uniform(-0.5, 0.5, (4, 3)), rng.uniform(-3.0, 3.0, (4, 3))
    off = np.zeros(4, dtype=np.bool_)
    tip, axis = machine.tip(p, angle, off), machine.tool_axis(angle)
    for row in range(4):
        p_row, axis_row = _composed(machine, p[row], angle[row])
        np.testing.assert_allclose(tip[row], p_row, atol=1e-12)
        np.testing.assert_allclose(axis[row], axis_row, atol=1e-12)
    np.testing.assert_allclose(machine.program_point(tip, angle, off), p, atol=1e-12)
    np.testing.assert_array_equal(machine.tip(p, angle, ~off), p)
    step = 1e-6 * rng.normal(size=(4, 3))
    columns = [a.index for a in machine.axes]
    change = machine.tool_axis(angle + step) - machine.tool_axis(angle - step)
    expected = 2.0 * np.einsum("nij,nj->ni", machine.tilting(angle), step[:, columns])
    np.testing.assert_allclose(change, expected, atol=1e-14)


@settings(max_examples=60)
@given(name=st.sampled_from(sorted(MACHINES)), tilt=st.floats(0.1, 1.5), turn=angles, seed=st.integers(0, 10_000))
def test_a_direction_leads_back_to_its_angles(name: str, tilt: float, turn: float, seed: int) -> None:
    machine, off = MACHINES[name], np.random.default_rng(seed).uniform(-0.04, 0.04, (1, 3))  # never nearly singular
    known = words(tilt if name == "table-table" else 0.0, 0.0 if name == "table-table" else tilt, turn)
    off[:, known[0] == 0.0] = 0.0
    np.testing.assert_allclose(machine.turned_to(machine.tool_axis(known), known + off), known, atol=1e-9)


def test_at_a_singular_position_the_angle_about_the_tool_stays() -> None:
    """A tool along C cannot lean to the side by small angles: C stays and B takes what it can."""
    wanted = np.array([[0.001, 0.001, 1.0]])
    wanted /= np.linalg.norm(wanted)
    angle = FORK.turned_to(wanted, words())
    np.testing.assert_allclose(angle, words(b=0.001), atol=1e-6)
    assert float(np.linalg.norm(FORK.tool_axis(angle) - wanted)) == pytest.approx(0.001, rel=1e-3)
    close = FORK.turned_to(wanted, words(b=2.0 * SINGULAR, c=np.pi / 4))  # far enough: both turn
    np.testing.assert_allclose(FORK.tool_axis(close), wanted, atol=1e-9)


@pytest.mark.parametrize(
    ("axes", "match"),
    [
        ((), "one or two"),
        ((RotaryAxis("A", "table", X), RotaryAxis("A", "head", Y)), "same word"),
        ((RotaryAxis("A", "table", X), RotaryAxis("B", "head", X)), "same direction"),
    ],
)
def test_axes_that_make_no_machine(axes: tuple[RotaryAxis, ...], match: str) -> None:
    with pytest.raises(InputError, match=match):
        RotaryMachine(axes)
