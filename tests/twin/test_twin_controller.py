"""The simulated robot controller: speed, corners, kinematics."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ReachError
from counterflex.path.toolpath import FEED, RAPID, ToolPath
from counterflex.robot.model.opw import BRANCHES
from counterflex.twin.plant.controller import CommandedReference, Controller
from counterflex.twin.truth.truth import Truth

UP = np.array([0.0, 0.0, 1.0])


def path_of(points: list[list[float]], feed: float = 0.025, kinds: list[int] | None = None) -> ToolPath:
    p = np.array(points)
    n = len(p)
    kind = np.array(kinds or [FEED] * n)
    length = np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1)
    return ToolPath(
        p, np.tile(UP, (n, 1)), kind, np.full(n, feed), np.full(n, 1361.0), np.cumsum(length / feed), np.arange(n),
        np.ones(n, dtype=np.int64),
    )  # fmt: skip


def test_straight_line_reaches_the_feed_and_keeps_the_acceleration(controller: Controller) -> None:
    r = CommandedReference.interpolated(path_of([[0, 0, 0], [0.1, 0, 0]]), controller)
    v = np.diff(r.p_part_command[:, 0]) / controller.cycle_s
    a = np.diff(v) / controller.cycle_s
    assert v.max() == pytest.approx(0.025, rel=1e-9)
    assert np.abs(a).max() < 1.001 * controller.acceleration_m_s2
    assert r.time_s[-1] == pytest.approx(0.1 / 0.025 + 0.025 / controller.acceleration_m_s2, abs=controller.cycle_s)
    np.testing.assert_allclose(r.p_part_command[[0, -1]], np.array([[0.0, 0, 0], [0.1, 0, 0]]), atol=1e-12)


def test_exact_stop_runs_through_the_corner(controller: Controller) -> None:
    corner = path_of([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0]])
    r = CommandedReference.interpolated(corner, replace(controller, blending_m=0.0))
    gap = np.linalg.norm(r.p_part_command - np.array([0.02, 0, 0]), axis=1)
    assert gap.min() < 0.5 * controller.acceleration_m_s2 * controller.cycle_s**2


@pytest.mark.parametrize("angle_deg", [20.0, 90.0, 150.0])
def test_blending_cuts_the_corner_by_the_parabola(controller: Controller, angle_deg: float) -> None:
    d, angle = 2e-3, math.radians(angle_deg)
    end = [0.02 + 0.02 * math.cos(angle), 0.02 * math.sin(angle), 0.0]
    r = CommandedReference.interpolated(path_of([[0, 0, 0], [0.02, 0, 0], end]), replace(controller, blending_m=d))
    gap = np.linalg.norm(r.p_part_command - np.array([0.02, 0, 0]), axis=1)
    assert gap.min() == pytest.approx(0.5 * d * math.sin(0.5 * angle), rel=0.05, abs=1e-6)
    v = np.diff(r.p_part_command, axis=0) / controller.cycle_s
    a = np.linalg.norm(np.diff(v, axis=0), axis=1) / controller.cycle_s
    assert a.max() < 2.5 * controller.acceleration_m_s2


def test_fine_chords_of_an_arc_run_at_full_feed(controller: Controller) -> None:
    phi = np.linspace(0, math.pi, 120)
    arc = [[0.02 * math.cos(f), 0.02 * math.sin(f), 0.0] for f in phi]
    r = CommandedReference.interpolated(path_of(arc), controller)
    v = np.linalg.norm(np.diff(r.p_part_command, axis=0), axis=1) / controller.cycle_s
    assert np.quantile(v[10:-10], 0.02) > 0.98 * 0.025


def test_dwell_takes_its_time(controller: Controller) -> None:
    p = path_of([[0, 0, 0], [0.02, 0, 0], [0.02, 0, 0], [0.04, 0, 0]])
    p = replace(p, time_s=np.array([0.0, 0.8, 1.3, 2.1]))
    r = CommandedReference.interpolated(p, controller)
    still = np.linalg.norm(r.p_part_command - np.array([0.02, 0, 0]), axis=1) < 1e-9
    assert 0.48 < np.count_nonzero(still) * controller.cycle_s < 0.53


def test_rapid_moves_use_their_own_speed(controller: Controller) -> None:
    r = CommandedReference.interpolated(path_of([[0, 0, 0.05], [0.15, 0, 0.05]], kinds=[RAPID, RAPID]), controller)
    v = np.linalg.norm(np.diff(r.p_part_command, axis=0), axis=1) / controller.cycle_s
    assert v.max() == pytest.approx(controller.rapid_m_s, rel=1e-6)


@pytest.mark.parametrize("branch", ["front up noflip", "front up flip"])
def test_joints_put_the_nominal_tool_on_the_path(
    controller: Controller, truth: Truth, T_base_part: Float, branch: str
) -> None:
    c = replace(controller, branch=branch)
    r = CommandedReference.interpolated(path_of([[0, 0, 0], [0.1, 0.03, -0.01], [0.1, 0.08, 0.0]]), c)
    expected = T_base_part @ c.tool_poses(r.p_part_command, r.axis_part)
    for k in range(0, len(r.time_s), 97):
        np.testing.assert_allclose(truth.rigid_tcp(r.q_ref[k]), expected[k], atol=1e-9)
    assert np.abs(np.diff(r.q_ref, axis=0)).max() < 0.01
    np.testing.assert_allclose(r.qd_ref[1:-1], (r.q_ref[2:] - r.q_ref[:-2]) / (2 * c.cycle_s), atol=1e-9)


def test_following_error(controller: Controller) -> None:
    path = path_of([[0, 0, 0], [0.15, 0, 0]])
    plain = CommandedReference.interpolated(path, controller)
    lagged = CommandedReference.interpolated(path, replace(controller, following_gain_per_s=20.0))
    k = len(plain.time_s) // 2
    np.testing.assert_allclose(plain.q_ref[k] - lagged.q_ref[k], plain.qd_ref[k] / 20.0, atol=2e-5)


def test_out_of_reach_names_the_place(controller: Controller) -> None:
    with pytest.raises(ReachError, match=r"part \["):
        CommandedReference.interpolated(path_of([[0, 0, 0], [3.0, 0, 0]]), controller)


def test_nonsense_is_refused(controller: Controller) -> None:
    with pytest.raises(InputError, match="posture"):
        replace(controller, branch="upside down")
    with pytest.raises(InputError):
        replace(controller, acceleration_m_s2=0.0)
    with pytest.raises(InputError, match="two points"):
        CommandedReference.interpolated(path_of([[0, 0, 0]]), controller)
    assert len(BRANCHES) == 8
