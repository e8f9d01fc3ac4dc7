"""Stability along a path: the deeper cut is the worse one, margins go with the depth, modes of the robot at the tip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from counterflex.app.inputs import setting_of
from counterflex.core.errors import ModelError, ProgramError
from counterflex.cutting.stability.modes import TipModes, modes_along
from counterflex.cutting.stability.response import Response
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import ToolPath
from counterflex.plan.inputs import solve_joints
from counterflex.plan.lowest_mode import Damping
from counterflex.plan.stability.along import Margin, Structure, confirmed, margins
from counterflex.plan.stability.criterion import LARGEST, robot_limit
from counterflex.plan.stability.diagram import diagram, needed_damping
from counterflex.plan.stability.robot_modes import robot_modes
from counterflex.plan.stability.stretches import smoothed, stretches_of
from counterflex.robot.elasticity.compliance import cartesian_compliance
from counterflex.signals.preview import Mode

TWO_CUTS = "G0 Z60\nG0 X-12 Y15\nG0 Z38\nG1 X30 F1500\nG0 Z60\nG0 X-12 Y38\nG0 Z36\nG1 X30 F1500\nG0 Z60"
"""Slots of 2 and 4 mm."""
TOOL = modes_along(np.array([900.0, 1100.0]), np.full(2, 0.03), np.array([2e7, 2e7]), np.eye(3)[:2])
TAPPED = Mode(2.0 * np.pi * 8.5, 0.1)
DAMPING = Damping.of(None, 0.1)


@pytest.fixture(scope="module")
def cell(cell_of: Callable[..., Cell]) -> Cell:
    """Two slots wide."""
    stock = {"box_min_mm": [0, 0, 0], "box_max_mm": [40, 60, 40], "cell_mm": 0.25}
    return cell_of(part={"stock": stock})


@pytest.fixture(scope="module")
def path(path_of: Callable[..., ToolPath]) -> ToolPath:
    return path_of(TWO_CUTS)


@pytest.fixture(scope="module")
def judged(path: ToolPath, cell: Cell) -> list[Margin]:
    return margins(path, cell.stock(), setting_of(cell), Structure(DAMPING, TAPPED, TOOL), cell.blank_box())


def _whole(judged: list[Margin], path: ToolPath, depth_mm: int) -> list[Margin]:
    """Stretches in the full slot of that depth."""
    p = path.p_part_tcp
    return [
        m for m in judged if abs(p[m.stretch.row, 2] - (40 - depth_mm) * 1e-3) < 1e-6 and p[m.stretch.row, 0] > 0.01
    ]


def test_margin_of_the_tool_goes_with_the_depth(judged: list[Margin], path: ToolPath) -> None:
    shallow, deep = (np.median([m.tool_margin for m in _whole(judged, path, depth)]) for depth in (2, 4))
    assert shallow == pytest.approx(2.0 * deep, rel=0.02)
    worst = min(judged, key=lambda m: m.margin)
    assert path.p_part_tcp[worst.stretch.row, 2] == pytest.approx(0.036)


def test_stretches_cover_the_cut_and_a_slot_is_a_slot(judged: list[Margin], path: ToolPath) -> None:
    """A full slot of 4 mm: the matrix of :mod:`test_process`, feed along x, 0.0385 mm per tooth at 650 Hz."""
    deep = _whole(judged, path, 4)
    assert len(deep) >= 10
    kt, kr, _ = deep[0].process.slopes_pa
    expected = 3.0 / 4.0 * 0.004 * np.array([[kr, kt], [-kt, kr]])
    np.testing.assert_allclose(deep[0].process.mean[:2, :2], expected, atol=0.03 * expected.max())
    assert deep[0].stretch.period_s == pytest.approx(60.0 / 13000.0 / 3.0)
    assert deep[0].stretch.feed_per_tooth_m == pytest.approx(0.025 * 60.0 / 13000.0 / 3.0)
    np.testing.assert_allclose(deep[0].stretch.direction_part, [1.0, 0.0, 0.0], atol=1e-9)


def test_semi_discretisation_confirms_the_worst(judged: list[Margin]) -> None:
    worst = min(judged, key=lambda m: m.margin)
    assert confirmed(worst, Structure(DAMPING, TAPPED, TOOL)) == pytest.approx(worst.margin, rel=0.15)


def test_measured_response_gives_what_its_modes_give(judged: list[Margin], path: ToolPath, cell: Cell) -> None:
    """A response that begins at 200 Hz leaves the robot below it to the model."""
    omega = 2.0 * np.pi * np.arange(200.0, 4000.0, 2.0)
    structure = Structure(DAMPING, TAPPED, Response(omega, TOOL.response(omega)))
    other = margins(path, cell.stock(), setting_of(cell), structure, cell.blank_box())
    for a, b in zip(judged[::5], other[::5], strict=True):
        assert b.tool_margin == pytest.approx(a.tool_margin, rel=0.02)
        assert b.robot_margin == pytest.approx(a.robot_margin, rel=1e-9)
    from_50 = Structure(DAMPING, TAPPED, Response(omega - omega[0] + 2.0 * np.pi * 5.0, TOOL.response(omega)))
    assert (
        min(m.robot_margin for m in margins(path, cell.stock(), setting_of(cell), from_50, cell.blank_box())) == LARGEST
    )


def test_diagram_passes_through_the_margin(judged: list[Margin]) -> None:
    worst = min(judged, key=lambda m: m.margin)
    structure = Structure(DAMPING, TAPPED, TOOL)
    lobes = diagram(worst, structure)
    speed = 2.0 * np.pi / (3.0 * worst.stretch.period_s)
    assert np.interp(speed, lobes.spindle_rad_s, lobes.zeroth) == pytest.approx(worst.margin, rel=0.1)
    fast = lobes.checked_rad_s > 0.5 * speed
    both = np.interp(lobes.checked_rad_s[fast], lobes.spindle_rad_s, lobes.zeroth)
    assert np.median(np.abs(lobes.semi_discretisation[fast] / both - 1.0)) < 0.1


def test_needed_damping_is_where_the_margin_is_one(path: ToolPath, cell: Cell) -> None:
    """The mode of the whole robot with one soft direction: half immersion feeds it."""
    robot = modes_along(np.array([12.0]), np.array([0.03]), np.array([3e5]), np.array([[0.0, 1.0, 0.0]]))
    worst = margins(path, cell.stock(), setting_of(cell), Structure(DAMPING, TAPPED))[20]
    half = replace(worst.process, arcs=worst.process.arcs[worst.process.arcs[:, 1] < 1.6])
    at = replace(worst, process=half, robot=robot, R_part_feed=np.eye(3))
    needed = needed_damping(at)
    lively = TipModes(robot.omega_rad_s, np.array([needed]), robot.shape)
    assert robot_limit(lively, half.mean, worst.stretch.period_s).factor == pytest.approx(1.0, rel=0.02)


def test_modes_hold_the_compliance_of_the_chain(path: ToolPath, cell: Cell) -> None:
    """Statically, all modes together yield as the chain does."""
    q = solve_joints(path, path.motion + 1, setting_of(cell)).q[0]
    static = robot_modes(cell.chain, q, np.eye(6), None, 0.05).response(np.array([0.0]))[0].real
    expected = cartesian_compliance(cell.chain, q)[:3, :3]
    np.testing.assert_allclose(static, expected, atol=0.05 * np.abs(expected).max())


def test_a_tap_test_places_the_modes_of_a_robot_without_masses(path: ToolPath, cell: Cell) -> None:
    q = solve_joints(path, path.motion + 1, setting_of(cell)).q[0]
    light = replace(cell.chain, mass=0.0 * cell.chain.mass)
    modes = robot_modes(light, q, np.eye(6), TAPPED, 0.05)
    assert modes.omega_rad_s[0] == pytest.approx(TAPPED.omega_rad_s)
    left_out = cartesian_compliance(cell.chain, q)[:3, :3] - modes.response(np.array([0.0]))[0].real
    assert np.linalg.eigvalsh(left_out).min() > -1e-9


def test_nothing_that_yields_has_no_modes(path: ToolPath, cell: Cell) -> None:
    rigid = replace(cell.chain, compliance=0.0 * cell.chain.compliance, regions=())
    with pytest.raises(ModelError, match="nothing of the robot yields"):
        robot_modes(rigid, np.zeros(6), np.eye(6), None, 0.05)


def test_even_engagement_keeps_the_volume() -> None:
    random = np.random.default_rng(4)
    depth = random.uniform(0.0, 2.0, (2, 64))
    width = -np.diff(np.cos(np.linspace(0.0, np.pi, 65)))
    even = smoothed(depth, 0.03)
    np.testing.assert_allclose((even @ width), depth @ width, rtol=1e-12)
    np.testing.assert_allclose(smoothed(np.ones((1, 64)), 0.03), 1.0, rtol=1e-9)


def test_cells_that_fall_into_every_other_bin_become_even() -> None:
    """A slot through cells of 0.25 mm under a tool of 8 mm radius, booked by the centres of the cells."""
    edges = np.cos(np.linspace(0.0, np.pi, 65))
    centres = np.arange(-7.875, 8.0, 0.25) / 8.0
    volume = np.histogram(-centres, -edges)[0] * 0.25 / 8.0
    booked = (volume / -np.diff(edges))[None]
    assert np.ptp(booked) > 1.0
    phi = np.linspace(0.0, np.pi, 65)
    cosine = 0.5 * np.diff(phi + 0.5 * np.sin(2.0 * phi))
    assert smoothed(booked, 0.25 / 8.0)[0] @ cosine == pytest.approx(0.5 * np.pi, rel=0.015)


@pytest.mark.parametrize(("spindle", "fault"), [(0.0, ProgramError), (-1.0, ModelError)], ids=["stopped", "M4"])
def test_spindle_must_turn(path: ToolPath, cell: Cell, spindle: float, fault: type[Exception]) -> None:
    wrong = replace(path, spindle_rad_s=spindle * path.spindle_rad_s)
    with pytest.raises(fault):
        stretches_of(wrong, cell.stock(), cell.cutter)
