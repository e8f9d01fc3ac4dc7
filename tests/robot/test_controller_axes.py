"""Axes as controllers show them: signs, zeros, coupling, limits, world; against poses that controllers showed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import controller_arms as judge
from controller_arms import Arm, Matrix
from counterflex.core.errors import InputError
from counterflex.core.units import DEG
from counterflex.robot.model import catalog
from counterflex.robot.model.controller_axes import (
    AS_MODEL,
    MAKERS,
    from_geometry,
    from_signs,
    in_language,
    maker_of,
    room,
    shown_limits,
)
from counterflex.robot.model.description import Opw

LIMITS = np.tile([-3.0, 3.0], (6, 1))
angles = st.lists(st.floats(-180.0, 180.0), min_size=6, max_size=6).map(np.array)


def offsets_of(maker: str) -> tuple[float, ...]:
    return tuple(value * DEG for value in MAKERS[maker].offsets_deg)


HIGH = ("fanuc", "staubli", "yaskawa")
"""Makers whose world lies at the height of axis 2."""


def opw_of(maker: str) -> Opw:
    rule = MAKERS[maker]
    return Opw(0.3, -0.1, 0.0, 0.6, 1.0, 1.1, 0.2, offsets_of(maker), rule.signs)


@pytest.mark.parametrize(
    ("forward", "arm", "axes", "position_mm", "R", "apart_mm"),
    [
        # FANUC LR Mate 200iD, poses of an R-30iB controller (github mattj23/lrmate-200id, test_cases).
        (judge.fanuc, Arm(330, 50, 0, 330, 35, 335, 80),
         [17.795304119777708, 9.63529729650715, 40.3284447668726, 41.9839869496418, 50.29966354151829,
          53.881649348808025], [318.11589386239353, 145.34934793767331, 636.7796296820055],
         [[-0.42918436, -0.90204268, -0.04604114], [0.7574045, -0.38720153, 0.52575031],
          [-0.49207642, 0.19077204, 0.84939203]], 1e-3),
        (judge.fanuc, Arm(330, 50, 0, 330, 35, 335, 80),
         [41.91594587983654, 59.778440136944376, 11.905550466812873, 19.526726322980927, 19.742308831048405,
          5.871320638379727], [532.8210829205959, 490.4790517736791, 309.9161489920663],
         [[-0.64834629, 0.51468448, 0.56102316], [-0.03193035, -0.75461718, 0.65538795],
          [0.76067572, 0.40700468, 0.5056873]], 1e-3),
        # Staubli RX160: joints and flange as a pendant showed them, two decimals (rx ry rz -94.11 1.35 89.94).
        (judge.staubli, Arm(550, 150, 0, 825, 0, 625, 110), [80.14, 43.01, 80.39, -16.98, -30.36, 13.99],
         [213.96, 1325.98, 251.27], judge.intrinsic_xyz(-94.11, 1.35, 89.94)[:3, :3], 0.15),
        # ABB IRB 4600-20/2.50, poses of a virtual controller (github Susta79/RF210001, README), two decimals.
        (judge.abb, Arm(495, 175, 0, 1095, 175, 1230.5, 85), [45.0] * 6, [734.88, 794.99, -21.32],
         judge.fixed_xyz(-144.74, -30.0, 125.26)[:3, :3], 0.01),
        (judge.abb, Arm(495, 175, 0, 1095, 175, 1230.5, 85), [-45.0] * 6, [-547.50, 607.60, 2559.89],
         judge.fixed_xyz(35.26, -30.0, -144.74)[:3, :3], 0.01),
        # KUKA KR 300 R2500 ultra: four sources agree (shared reference: robots, 2.).
        (judge.kuka, Arm(675, 350, 0, 1150, -41, 1000, 240), [30.0, -70.0, 100.0, 40.0, 50.0, -60.0],
         [1371.611980, -928.359511, 1021.035863], None, 1e-5),
        (judge.kuka, Arm(675, 350, 0, 1150, -41, 1000, 240), [10.0] * 6, [2575.257796, -461.435958, -24.647983], None,
         1e-5),
    ],
)  # fmt: skip
def test_the_judges_agree_with_published_poses(
    forward: object, arm: Arm, axes: list[float], position_mm: list[float], R: Matrix | None, apart_mm: float
) -> None:
    assert callable(forward)
    T = forward(arm, np.array(axes))
    np.testing.assert_allclose(T[:3, 3], position_mm, atol=apart_mm)
    if R is not None:
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-6 if apart_mm < 0.005 else 3e-4)


@pytest.mark.parametrize("maker", list(MAKERS))
@given(q=angles)
@settings(max_examples=25)
def test_shown_and_model_are_inverse(maker: str, q: Matrix) -> None:
    signs = (1, -1, 1, -1, 1, -1)
    axes = from_geometry(maker, signs, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), 0.6, "horizontal")
    np.testing.assert_allclose(axes.model(axes.shown(q)), q, atol=1e-10)
    np.testing.assert_allclose(axes.shown(q + 0.1) - axes.shown(q), axes.shown_change(np.full(6, 0.1)), atol=1e-9)
    np.testing.assert_allclose(axes.model_change(axes.shown_change(q)), q, atol=1e-10)


@pytest.mark.parametrize("name", catalog.names())
def test_catalogue_robots_are_counted_as_their_makers_do(name: str) -> None:
    robot = catalog.load(name)
    assert robot.opw is not None
    assert robot.axes.maker == maker_of(robot.opw.signs, robot.opw.offsets_rad)
    assert robot.axes.matrix is None
    assert not robot.axes.coupled
    high = robot.axes.maker in HIGH
    assert robot.axes.world_m == (robot.opw.c1_m if high else 0.0)


def test_fanuc_counts_axis_3_from_the_horizontal() -> None:
    rule = MAKERS["fanuc"]
    axes = from_geometry("fanuc", rule.signs, offsets_of("fanuc"), 0.67)
    q = np.array([0.0, -21.16763, -57.51804, 0.0, 0.0, 0.0]) * DEG
    assert axes.shown(q)[2] / DEG == pytest.approx(-36.35041, abs=1e-9)
    moved = axes.model(axes.shown(q) + np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0]))
    assert moved[2] - q[2] == pytest.approx(0.3)  # J2 alone keeps the forearm's direction


def test_a_parallel_rod_of_abb_adds_axis_2() -> None:
    rule = MAKERS["abb"]
    axes = from_geometry("abb", rule.signs, offsets_of("abb"), 0.6, "horizontal")
    assert axes.shown(np.array([0.0, 0.2, 0.1, 0.0, 0.0, 0.0]))[2] == pytest.approx(0.3)


@pytest.mark.parametrize("maker", list(MAKERS))
@pytest.mark.parametrize("of", list(MAKERS))
def test_any_arm_on_any_controller_points_where_the_judge_says(maker: str, of: str) -> None:
    from counterflex.robot.elasticity.chain import ElasticChain, flange
    from counterflex.robot.model.opw_chain import from_opw

    opw = opw_of(of)
    chain = ElasticChain.build(from_opw("arm", opw, LIMITS))
    robot_axes = from_geometry(of, opw.signs, opw.offsets_rad, opw.c1_m, "upper_arm" if of == "abb" else None)
    axes, _ = in_language(robot_axes, opw, LIMITS, MAKERS[maker].language, "cell")
    both = maker in HIGH and of in HIGH
    assert axes.world_m == (opw.c1_m if both else 0.0)
    forward = getattr(judge, maker)
    arm = Arm(600, 300, 0, 1000, 100, 1100, 200)
    for q in np.random.default_rng(3).uniform(-2.0, 2.0, (20, 6)):
        T = flange(chain, q)
        T[2, 3] -= opw.c1_m if maker in HIGH else 0.0
        T[:3, 3] *= 1e3
        np.testing.assert_allclose(forward(arm, axes.shown(q) / DEG), T, atol=1e-9)


def test_limits_are_those_of_the_controller() -> None:
    limits = np.array([[-180, 180], [-60, 70], [-70, 65], [-200, 200], [-120, 120], [-350, 350]]) * DEG
    axes = from_geometry("abb", MAKERS["abb"].signs, offsets_of("abb"), 0.6, "horizontal", limits)
    box = axes.model_limits(np.array([-90.0, 60.0]) * DEG)
    np.testing.assert_allclose(box[2] / DEG, [-90.0, 60.0], atol=1e-9)
    np.testing.assert_allclose(axes.model_limits()[2] / DEG, [-140.0, 125.0], atol=1e-9)
    q = axes.model(np.array([0.0, 60.0, 64.0, 0.0, 0.0, 0.0]) * DEG)
    assert room(axes, box, q)[2] / DEG == pytest.approx(1.0)
    q = axes.model(np.array([0.0, -60.0, 5.0, 0.0, 0.0, 0.0]) * DEG)
    assert room(axes, box, q)[2] / DEG == pytest.approx(-5.0)  # 65 deg between the arms, of at most 60
    np.testing.assert_array_equal(shown_limits(axes, box), limits)


def test_what_is_not_known_is_refused() -> None:
    unknown = Opw(0.3, 0.0, 0.0, 0.6, 1.0, 1.1, 0.2, (0.3,) * 6, (1, -1, 1, -1, 1, -1))
    with pytest.raises(InputError, match=r"how the FANUC controller counts .* not known.*robot.controller_axes"):
        in_language(AS_MODEL, unknown, LIMITS, "fanuc", "cell.toml")
    rodded = np.array([[-180, 180], [-60, 70], [-60, 65], [-200, 200], [-120, 120], [-350, 350]]) * DEG
    axes = from_geometry("abb", MAKERS["abb"].signs, offsets_of("abb"), 0.6)
    with pytest.raises(InputError, match=r"parallel rod.*axis_3_from"):
        in_language(axes, opw_of("abb"), rodded, "rapid", "cell.toml")
    wide = rodded.copy()
    wide[2] = np.array([-180.0, 70.0]) * DEG
    _, said = in_language(axes, opw_of("abb"), wide, "rapid", "cell.toml")
    assert "axis_3_from" in said[0]


def test_signs_and_zeros_of_another_model_are_taken_off() -> None:
    axes = from_signs("fanuc", (1, -1, 1, 1, 1, -1), (0.0, 0.1, 0.2, 0.0, 0.0, 3.0), 0.5, "upper_arm")
    shown = axes.shown(np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(shown, [1.0, -0.9, 1.2, 1.0, 1.0, 2.0], atol=1e-12)
