"""Lost motion: the loop of a reversal, memory, rate independence, losses, rest, and the chain around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import URAD
from counterflex.geometry import pose
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.chain import ElasticChain, forward, jacobian
from counterflex.robot.elasticity.compliance import element_loads
from counterflex.robot.elasticity.gravity import sag, weight_loads
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector, Play, Robot, Segment

C = 1.0 / 7.5e6  # torsion of axis 1 of a KR 300, rad/(N m)
LIMIT = (75.0, 105.0, 120.0)  # 300 N m together
SLIP = (10.0 * URAD, 25.0 * URAD, 60.0 * URAD)


def one_axis(
    q: Float, torque: Float, *, band: float = 0.0, limit: tuple[float, ...] = (), slip: tuple[float, ...] = ()
) -> Float:
    """Torsion of a single axis along a path."""
    loads = np.broadcast_to(torque, np.shape(q)).astype(np.float64)
    return play.torsion_path(
        np.asarray(q, dtype=np.float64)[:, None],
        loads[:, None],
        np.array([C]),
        np.array([band]),
        np.array([limit]).reshape(1, -1),
        np.array([slip]).reshape(1, -1),
    )[:, 0]


def zigzag(span: float, rows: int = 400) -> Float:
    """Up, down, up: two full loops after the first loading."""
    up = np.linspace(0.0, span, rows)
    return np.concatenate([up, up[::-1], up, up[::-1], up])


@pytest.mark.parametrize(
    ("band", "friction", "width"),
    [(25.0, 0.0, 50.0), (0.0, 300.0, 80.0), (25.0, 300.0, 130.0)],
    ids=["dead band only", "friction only", "both"],
)
def test_lost_motion_of_a_loaded_reversal_is_the_published_one(band: float, friction: float, width: float) -> None:
    """Axis held at the motor, torque swung far to both sides: 2 b + 2 c F between the branches at zero torque.

    The link moves far enough for every element to slip. Figures of the reference prototype: 50, 80 and 130 urad.
    """
    swing = np.concatenate([np.linspace(0, 6e3, 500), np.linspace(6e3, -6e3, 2001), np.linspace(-6e3, 6e3, 2001)])
    limit = tuple(share * friction for share in (0.25, 0.35, 0.40))
    s = one_axis(np.zeros(len(swing)), swing, band=band * URAD, limit=limit, slip=SLIP)
    beyond = 500  # N m past zero, where the play is taken up; friction has turned round by then
    down = float(np.interp(-(3e3), -swing[500:2501], s[500:2501]))  # torque falls: friction still holds it up
    up = float(np.interp(3e3, swing[2501:], s[2501:]))
    assert beyond < 3e3
    assert down - up == pytest.approx(2 * C * friction, abs=1e-3 * URAD)
    # over the whole torque reversal the play is crossed too
    high, low = float(np.interp(-3e3, -swing[500:2501], s[500:2501])), float(np.interp(-3e3, swing[2501:], s[2501:]))
    elastic = C * 6e3
    assert (high - low) - elastic == pytest.approx(width * URAD, abs=1e-3 * URAD)


def test_unloaded_drive_reversal_loses_two_bands_and_two_friction_windups() -> None:
    """No torque but friction itself: link against motor angle, 2 b + 2 c F wide; the prototype's 130 urad."""
    q = zigzag(1e-3)
    s = one_axis(q, np.zeros(1), band=25 * URAD, limit=LIMIT, slip=SLIP)
    down, up = s[799 - 100], s[1199 - 100]
    assert down == pytest.approx(25 * URAD + C * 300, abs=1e-12)
    assert up == pytest.approx(-25 * URAD - C * 300, abs=1e-12)
    assert down - up == pytest.approx(130 * URAD, abs=1e-3 * URAD)


def test_nothing_without_play_and_friction() -> None:
    q = zigzag(1e-3)
    torque = 1e3 * np.sin(np.arange(len(q)) / 70.0)
    assert one_axis(q, torque) == pytest.approx(C * torque, abs=1e-15)
    assert one_axis(q, torque, limit=(0.0,), slip=(1e-5,)) == pytest.approx(C * torque, abs=1e-15)


def test_constant_input_does_not_creep() -> None:
    q = np.concatenate([np.linspace(0, 3e-5, 50), np.full(5000, 3e-5)])
    s = one_axis(q, np.full(1, 400.0), band=20 * URAD, limit=LIMIT, slip=SLIP)
    assert np.ptp(s[50:]) < 1e-15
    held = one_axis(q, np.zeros(1), band=20 * URAD, limit=LIMIT, slip=SLIP)  # within the play, held by friction
    assert np.ptp(held[50:]) < 1e-12


moves = st.lists(st.floats(-2e-4, 2e-4), min_size=2, max_size=12)
loads = st.lists(st.floats(-2e3, 2e3), min_size=12, max_size=12)


@settings(max_examples=60, deadline=None)
@given(turns=moves, load=st.floats(-2e3, 2e3), parts=st.integers(2, 9))
def test_only_the_order_of_reversals_counts(turns: list[float], load: float, parts: int) -> None:
    """Rate independence: finer steps between the same reversals at steady torque end in the same place."""
    q = np.concatenate([[0.0], turns])
    fine = np.interp(np.linspace(0, len(q) - 1, parts * (len(q) - 1) + 1), np.arange(len(q)), q)
    torque = np.array([load if abs(load) > 1.0 else 1.0])
    coarse = one_axis(q, torque, band=20 * URAD, limit=LIMIT, slip=SLIP)
    assert one_axis(fine, torque, band=20 * URAD, limit=LIMIT, slip=SLIP)[::parts] == pytest.approx(coarse, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(turns=moves, torques=loads)
def test_balance_and_saturation(turns: list[float], torques: list[float]) -> None:
    """At every point the spring carries the load within the friction, and s lies within c (|T| + F) + b of zero."""
    q, torque = np.concatenate([[0.0], turns]), np.array([*torques, 0.0])[: len(turns) + 1]
    s = one_axis(q, torque, band=20 * URAD, limit=LIMIT, slip=SLIP)
    dead = 20 * URAD
    spring = np.where(np.abs(s) > dead, (s - np.sign(s) * dead) / C, 0.0)
    assert np.all(np.abs(spring[1:] - torque[1:]) <= 300.0 + 1e-5)


@settings(max_examples=40, deadline=None)
@given(span=st.floats(1e-6, 1e-3), load=st.floats(-1e3, 1e3))
def test_a_closed_cycle_costs_work(span: float, load: float) -> None:
    """Passivity: round a closed cycle of the motor the drive does work on the axis, never the other way."""
    q = zigzag(span, 200)
    s = one_axis(q, np.array([load]), band=20 * URAD, limit=LIMIT, slip=SLIP)
    dead = 20 * URAD
    drive = -np.where(np.abs(s) > dead, (s - np.sign(s) * dead) / C, 0.0)  # torque of the motor on the spring
    cycle = slice(599, 1000)  # from the second top back to it
    top = slice(400 + 199, 400 + 199 + 401)
    assert cycle.start == top.start
    work = float(np.sum(0.5 * (drive[top][1:] + drive[top][:-1]) * np.diff(q[top])))
    assert work >= -1e-9
    if span > 4e-4:
        assert work > 0.9 * 2 * span * 300.0 * 0.5


def test_small_cycles_are_nearly_elastic() -> None:
    """Below the smallest slip angle nothing yields: the link comes back."""
    q = zigzag(4e-6, 50)
    s = one_axis(q, np.full(1, 500.0), limit=LIMIT, slip=SLIP)
    assert s[-1] == pytest.approx(s[49], abs=1e-15)
    assert s[99] == pytest.approx(s[0], abs=1e-15)


@pytest.fixture(scope="module")
def lossy() -> ElasticChain:
    big = Play(20 * URAD, LIMIT, SLIP)
    small = Play(50 * URAD, (12.5, 17.5, 20.0), SLIP)
    robot = replace(catalog.load("kuka_kr300_r2500_ultra"), play=(big, big, big, small, small, None))
    tool = EndEffector((Segment("spindle", pose.make(p=np.array([0, 0, 0.1])), mass_kg=75.0),), np.eye(4))
    return ElasticChain.build(robot, tool)


HOME = np.radians([3.0, -95.0, 125.0, 10.0, 31.0, 20.0])


def path(n: int = 60) -> Float:
    t = np.linspace(0.0, 2 * np.pi, n)[:, None]
    return HOME + 0.02 * (np.sin(t) * [1.0, 0.5, -0.5, 0.3, 0.7, 1.0])


def test_axes_without_an_entry_lose_nothing_and_the_others_do(lossy: ElasticChain) -> None:
    lost = play.lost_motion(lossy, path())
    assert np.all(lost[:, 5] == 0.0)
    assert np.all(np.ptp(lost[:, :5], axis=0) > 10 * URAD)
    assert np.all(play.lost_motion(replace(lossy, play=None), path()) == 0.0)
    assert np.all(play.relaxed(replace(lossy, play=None), path()) == 0.0)


def test_first_point_is_relaxed(lossy: ElasticChain) -> None:
    assert play.lost_motion(lossy, path())[0] == pytest.approx(play.relaxed(lossy, path())[0], abs=1e-12)
    band = np.abs(play.relaxed(lossy, path())[:, [1, 2]])
    assert band == pytest.approx(20 * URAD, rel=1e-9)  # weight takes up the play of axes 2 and 3


def test_torque_is_what_virtual_work_says(lossy: ElasticChain) -> None:
    """J^T w of the process, and minus the gradient of the potential energy of the bodies, cylinder left out."""
    bare = replace(lossy, counterbalance=None)
    q, w = path(7), np.tile([200.0, -500.0, 100.0, 3.0, -4.0, 5.0], (7, 1))
    of_process = play.axis_torque(bare, q, w) - play.axis_torque(bare, q)
    assert of_process == pytest.approx((np.swapaxes(jacobian(bare, q), -1, -2) @ w[..., None])[..., 0], abs=1e-9)
    from counterflex.robot.elasticity.chain import frames

    def energy(angles: Float) -> float:
        Ts = frames(bare, angles)
        com = (Ts[:, :3, :3] @ bare.com[..., None])[..., 0] + Ts[:, :3, 3]
        return -float(np.sum(bare.mass[:, None] * com * bare.gravity))

    step = 1e-4
    for axis in range(6):
        d = step * np.eye(6)[axis]
        slope = -(energy(q[3] + d) - energy(q[3] - d)) / (2 * step)
        assert play.axis_torque(bare, q)[3, axis] == pytest.approx(slope, abs=1e-3)


def test_tool_displacement_is_that_of_turned_axes(lossy: ElasticChain) -> None:
    q, angle = path(5), np.full((5, 6), 30 * URAD)
    moved = forward(lossy, q + angle)[:, :3, 3] - forward(lossy, q)[:, :3, 3]
    assert play.at_tcp(lossy, q, angle)[:, :3] == pytest.approx(moved, abs=2e-8)


def split(robot: Robot) -> Robot:
    """The same robot with each axis' elasticity in a bearing segment behind its drive, in the same place."""
    segments: list[Segment] = []
    for segment in robot.segments:
        if segment.joint is None:
            segments.append(segment)
            continue
        segments.append(replace(segment, compliance=np.zeros(6), mass_kg=0.0, p_seg_com=np.zeros(3)))
        segments.append(
            replace(segment, name=f"{segment.name}_bearing", T_prev_seg=np.eye(4), joint=None, sign=1.0, offset_rad=0.0)
        )
    return replace(robot, segments=tuple(segments))


def test_torsion_in_a_bearing_behind_the_drive_is_found(lossy: ElasticChain) -> None:
    """Weight, cylinder and play act on it as on the drive's own."""
    robot = replace(catalog.load("kuka_kr300_r2500_ultra"), play=lossy.play)
    tool = EndEffector((Segment("spindle", pose.make(p=np.array([0, 0, 0.1])), mass_kg=75.0),), np.eye(4))
    apart = ElasticChain.build(split(robot), tool)
    assert [apart.names[i] for i in apart.torsion] == [f"axis{i}_bearing" for i in range(1, 7)]
    assert [lossy.names[i] for i in lossy.torsion] == [f"axis{i}" for i in range(1, 7)]
    q = path(9)
    for equilibrium in (False, True):
        assert sag(apart, q, equilibrium=equilibrium) == pytest.approx(
            sag(lossy, q, equilibrium=equilibrium), abs=1e-12
        )
    assert play.lost_motion(apart, q) == pytest.approx(play.lost_motion(lossy, q), abs=1e-15)
    assert weight_loads(apart, q)[:, apart.torsion, 5] == pytest.approx(weight_loads(lossy, q)[:, lossy.torsion, 5])
    w = np.ones((9, 6))
    assert element_loads(apart, q, w)[:, apart.torsion, 5] == pytest.approx(
        element_loads(lossy, q, w)[:, lossy.torsion, 5]
    )


@pytest.mark.parametrize(
    "entry",
    [
        Play(-1e-6),
        Play(0.1),
        Play(0.0, (100.0,), ()),
        Play(0.0, (-1.0,), (1e-5,)),
        Play(0.0, (100.0,), (0.0,)),
        Play(0.0, (float("nan"),), (1e-5,)),
    ],
)
def test_impossible_play_is_refused(entry: Play) -> None:
    robot = replace(catalog.load("kuka_kr300_r2500_ultra"), play=(entry, None, None, None, None, None))
    with pytest.raises(ModelError, match="axis 1"):
        ElasticChain.build(robot)


def test_wrong_arrays_are_refused() -> None:
    with pytest.raises(InputError):
        one_axis(np.zeros(3), np.zeros(3), band=-1e-6)
    with pytest.raises(InputError):
        one_axis(np.zeros(3), np.zeros(3), limit=(1.0,), slip=(0.0,))
    with pytest.raises(ModelError, match="one entry per driven axis"):
        ElasticChain.build(replace(catalog.load("kuka_kr300_r2500_ultra"), play=(None,) * 5))
