"""The catalogue against published poses, an independent forward kinematics, and what its sources say."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import DEG, MM
from counterflex.robot.elasticity import compliance
from counterflex.robot.elasticity.chain import ElasticChain, flange, forward, frames
from counterflex.robot.kinematics import inverse
from counterflex.robot.model import catalog, load_cases
from counterflex.robot.model.description import EndEffector, Opw
from counterflex.robot.model.opw_chain import Element

KR300 = "kuka_kr300_r2500_ultra"
LIMITS = np.tile([-3.0, 3.0], (6, 1))
length = st.floats(0.05, 2.0)
angle = st.floats(-3.1, 3.1)


def opw_forward(opw: Opw, q: Float) -> Float:
    """Closed-form forward kinematics as printed by Brandstoetter et al. 2014, written apart from the chain."""
    t1, t2, t3, t4, t5, t6 = np.array(opw.signs) * q - np.array(opw.offsets_rad)
    psi = math.atan2(opw.a2_m, opw.c3_m)
    k = math.hypot(opw.a2_m, opw.c3_m)
    cx1 = opw.c2_m * math.sin(t2) + k * math.sin(t2 + t3 + psi) + opw.a1_m
    cy1 = opw.b_m
    cz1 = opw.c2_m * math.cos(t2) + k * math.cos(t2 + t3 + psi)
    wrist = np.array([cx1 * math.cos(t1) - cy1 * math.sin(t1), cx1 * math.sin(t1) + cy1 * math.cos(t1), cz1 + opw.c1_m])
    s1, c1, s23, c23 = math.sin(t1), math.cos(t1), math.sin(t2 + t3), math.cos(t2 + t3)
    s4, c4, s5, c5, s6, c6 = math.sin(t4), math.cos(t4), math.sin(t5), math.cos(t5), math.sin(t6), math.cos(t6)
    R_base_arm = np.array([[c1 * c23, -s1, c1 * s23], [s1 * c23, c1, s1 * s23], [-s23, 0.0, c23]])
    R_arm_flange = np.array(
        [
            [c4 * c5 * c6 - s4 * s6, -c4 * c5 * s6 - s4 * c6, c4 * s5],
            [s4 * c5 * c6 + c4 * s6, -s4 * c5 * s6 + c4 * c6, s4 * s5],
            [-s5 * c6, s5 * s6, c5],
        ]
    )
    T = np.eye(4)
    T[:3, :3] = R_base_arm @ R_arm_flange
    T[:3, 3] = wrist + opw.c4_m * T[:3, 2]
    return T


@pytest.mark.parametrize("name", catalog.names())
def test_published_flange_poses(name: str) -> None:
    chain = ElasticChain.build(catalog.load(name), None)
    entry = catalog.entry(name)
    assert len(entry.checks) >= 4
    for check in entry.checks:
        T = flange(chain, np.array(check.q_deg) * DEG)
        np.testing.assert_allclose(T[:3, 3], np.array(check.position_mm) * MM, rtol=0, atol=2e-8)
        np.testing.assert_allclose(T[:3, :3], np.array(check.rotation), rtol=0, atol=2e-9)


@pytest.mark.parametrize("name", catalog.names())
def test_every_robot_states_where_its_numbers_come_from(name: str) -> None:
    entry, robot = catalog.entry(name), catalog.load(name)
    groups = {
        "geometry", "limits", "speeds", "accelerations", "masses", "bearings", "counterbalance",
        "stiffness_about_axes", "stiffness_tilt", "stiffness_links", "stiffness_translation",
    }  # fmt: skip
    assert groups <= set(entry.sources)
    assert entry.status in ("VERIFIED", "SECONDARY")
    assert all(bool(p.source) != (p.status == "not known") for p in entry.sources.values())
    soft = np.array([s.compliance for s in robot.segments])
    known = {g: entry.sources[g].status != "not known" for g in groups}
    assert known["masses"] == any(s.mass_kg > 0.0 for s in robot.segments)
    assert known["speeds"] == (robot.joint_speeds_rad_s is not None)
    assert known["accelerations"] == (robot.joint_accelerations_rad_s2 is not None)
    assert known["counterbalance"] == (robot.counterbalance is not None)
    assert known["stiffness_about_axes"] == bool(np.any(soft[:, 5] > 0.0))
    assert known["stiffness_tilt"] == bool(np.any(soft[:, 3:5] > 0.0))
    assert not np.any(soft[:, :3])
    assert np.all(robot.joint_limits_rad[:, 0] < robot.joint_limits_rad[:, 1])


def test_catalogue_holds_the_robots_the_papers_mill_with() -> None:
    names = catalog.names()
    assert len(names) >= 24
    assert names == sorted(names)
    assert {KR300, "kuka_kr500_r2830", "staubli_rx160", "abb_irb6640_185_280", "kuka_kr210_r2700_2"} <= set(names)
    makers = {catalog.entry(name).manufacturer for name in names}
    assert makers == {"ABB", "KUKA", "Staubli"}


def test_kr300_carries_the_table_of_haehn2020() -> None:
    stiffness_nm = {  # k_C, k_B, k_A of Table 1, N m/rad
        "axis1": (1.2e7, 1.2e7, 7.5e6),
        "axis2": (6.1e6, 6.1e6, 5.4e6),
        "link_arm": (1.2e7, 3.8e6, 1.0e7),
        "axis3": (6.2e6, 6.2e6, 4.3e6),
        "arm": (6.1e6, 1.3e7, 3.0e6),
        "axis4": (3.0e6, 3.0e6, 9.0e5),
        "axis5": (2.5e6, 2.5e6, 8.0e5),
        "axis6": (6.7e5, 6.7e5, 4.9e5),
    }
    robot = catalog.load(KR300)
    assert [s.name for s in robot.segments] == list(stiffness_nm)
    for segment in robot.segments:
        np.testing.assert_allclose(segment.compliance[3:], 1.0 / np.array(stiffness_nm[segment.name]), rtol=1e-12)
    elements = catalog.end_effector_elements()
    np.testing.assert_allclose(
        1.0 / elements["haehn2020_sensor"].segment.compliance[3:], [3.3e6, 3.3e6, 5.2e6], rtol=1e-12
    )
    np.testing.assert_allclose(
        1.0 / elements["haehn2020_spindle_holder"].segment.compliance[3:], [1.9e5, 6.7e4, 9.1e4], rtol=1e-12
    )
    assert "ASSUMED" in elements["haehn2020_spindle_holder"].frame.source


def test_kr300_elements_sit_where_their_source_says() -> None:
    robot = catalog.load(KR300)
    chain = ElasticChain.build(robot, None)
    Ts = frames(chain, np.zeros(6))
    place = {s.name: Ts[i] for i, s in enumerate(robot.segments)}
    np.testing.assert_allclose(place["axis1"][:3, 3], [0.0, 0.0, 0.35], atol=1e-12)
    np.testing.assert_allclose(place["link_arm"][:3, 3], [0.35 + 0.5, 0.0, 0.675], atol=1e-12)
    np.testing.assert_allclose(place["arm"][:3, 3], [0.35 + 1.15 + 0.20, 0.0, 0.675 - 0.041], atol=1e-12)
    np.testing.assert_allclose(place["axis4"][:3, 3], [0.35 + 1.15 + 0.42, 0.0, 0.634], atol=1e-12)
    np.testing.assert_allclose(place["axis6"][:3, 3], [0.35 + 1.15 + 1.0 + 0.13, 0.0, 0.634], atol=1e-12)
    forward_x = np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(place["link_arm"][:3, 1], forward_x, atol=1e-12)  # k_B: torsion about the link arm
    np.testing.assert_allclose(place["arm"][:3, 2], forward_x, atol=1e-12)  # k_A: torsion about the arm
    np.testing.assert_allclose(np.abs(place["arm"][:3, 1]), [0.0, 1.0, 0.0], atol=1e-12)
    assert sum(s.mass_kg for s in robot.segments) == pytest.approx(820.0)


def test_kr300_gas_cylinder_matches_the_recorded_pressure() -> None:
    """Recorded in bar at angles of axis 2; the model's pressure is torque over lever and area."""
    balance = catalog.load(KR300).counterbalance
    assert balance is not None
    for angle_deg, bar in ((-120, 170), (-110, 167), (-80, 164), (-70, 170), (-60, 180), (-50, 190), (-40, 200)):
        d = angle_deg * DEG - balance.q_min_force_rad
        long, short = balance.anchor_column_m, balance.anchor_arm_m
        lever = long * short * math.sin(d) / math.sqrt(long**2 + short**2 - 2 * long * short * math.cos(d))
        torque = float(balance.torque(angle_deg * DEG))
        pressure = -torque / (lever * balance.piston_area_m2)
        assert pressure == pytest.approx(bar * 1e5, rel=0.05)


def test_unknown_robot_names_its_nearest() -> None:
    with pytest.raises(InputError, match="kuka_kr300_r2500_ultra"):
        catalog.load("kuka_kr300_r2500")
    with pytest.raises(InputError, match="no robot"):
        catalog.entry("../catalog_data/kuka_kr300_r2500_ultra")


def test_broken_catalogue_file_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("robots")
    (folder / "mine.toml").write_text('format = "counterflex-robot"\nversion = 1\nname = "mine"\nmass = 3\n')
    monkeypatch.setattr(catalog, "_folder", lambda: folder)
    catalog.entry.cache_clear()
    try:
        with pytest.raises(FileFormatError, match=r"mine\.toml"):
            catalog.entry("mine")
    finally:
        monkeypatch.undo()
        catalog.entry.cache_clear()


def test_arrays_of_a_loaded_robot_cannot_be_changed() -> None:
    robot = catalog.load(KR300)
    with pytest.raises(ValueError, match="read-only"):
        robot.segments[0].compliance[5] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        robot.T_last_flange[0, 3] = 1.0


def test_axis_4_lies_below_axis_3_only_in_the_older_generation() -> None:
    """Sign trap: OPW a2 > 0 is axis 4 below axis 3 at A1..A6 = 0."""
    for name, offset_mm in ((KR300, -41.0), ("kuka_kr210_2", -55.0), ("kuka_kr210_r2700_2", 115.0)):
        robot = catalog.load(name)
        Ts = frames(ElasticChain.build(robot, None), np.zeros(6))
        height = {s.name: Ts[i, 2, 3] for i, s in enumerate(robot.segments)}
        assert (height["axis4"] - height["axis3"]) / MM == pytest.approx(offset_mm, abs=1e-9)


def test_sense_of_axis_1() -> None:
    """KUKA turns axis 1 clockwise seen from above, ABB and Staubli counterclockwise."""
    for name, sense in (
        (KR300, -1.0),
        ("kuka_kr210_r3100_ultra", -1.0),
        ("abb_irb6700_235_265", 1.0),
        ("staubli_rx160", 1.0),
    ):
        chain = ElasticChain.build(catalog.load(name), None)
        q = np.array([0.1, 0.0, 0.0, 0.0, 0.3, 0.0])
        moved = forward(chain, q) @ np.linalg.inv(forward(chain, q * [0, 1, 1, 1, 1, 1]))
        assert math.atan2(moved[1, 0], moved[0, 0]) == pytest.approx(sense * 0.1)


@settings(max_examples=60, deadline=None)
@given(
    lengths=st.tuples(length, st.floats(-0.5, 0.5), st.floats(-0.2, 0.2), length, length, length, length),
    offsets=st.tuples(*[angle] * 6),
    signs=st.tuples(*[st.sampled_from([-1, 1])] * 6),
    q=st.tuples(*[angle] * 6),
    bearings=st.tuples(*[st.floats(-1.0, 1.0)] * 6),
)
def test_chain_equals_the_closed_form_wherever_the_bearings_sit(
    lengths: tuple[float, ...],
    offsets: tuple[float, ...],
    signs: tuple[int, ...],
    q: tuple[float, ...],
    bearings: tuple[float, ...],
) -> None:
    a1, a2, b, c1, c2, c3, c4 = lengths
    opw = Opw(a1, a2, b, c1, c2, c3, c4, offsets, signs)
    middle = Element("link", 1, np.array([[0, -1, 0, 0.2], [1, 0, 0, 0.1], [0, 0, 1, -0.3], [0, 0, 0, 1.0]]))
    end = Element("plate", 5, np.array([[1, 0, 0, 0], [0, 0, -1, 0.1], [0, 1, 0, 0.2], [0, 0, 0, 1.0]]))
    robot = catalog.from_opw("own", opw, LIMITS, bearings_m=np.array(bearings), elements=[middle, end])
    assert [s.name for s in robot.segments] == [
        "axis1", "axis2", "link", "axis3", "axis4", "axis5", "axis6", "plate",
    ]  # fmt: skip
    T = forward(ElasticChain.build(robot, None), np.array(q))
    np.testing.assert_allclose(T, opw_forward(opw, np.array(q)), rtol=0, atol=1e-13)


def test_end_effector_elements_make_an_end_effector() -> None:
    elements = catalog.end_effector_elements()
    tool = EndEffector(tuple(elements[k].segment for k in ("haehn2020_sensor",)), np.eye(4))
    chain = ElasticChain.build(catalog.load(KR300), tool)
    np.testing.assert_allclose(forward(chain, np.zeros(6)), flange(chain, np.zeros(6)), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"signs": (1, 1, 1, 1, 1)}, "signs"),
        ({"signs": (1, 1, 1, 1, 1, 2)}, "signs"),
        ({"offsets_rad": (0.0,) * 5}, "offsets"),
        ({"c2_m": 0.0}, "link arm"),
        ({"c3_m": 0.0, "a2_m": 0.0}, "forearm"),
        ({"c1_m": math.nan}, "finite"),
    ],
)
def test_impossible_geometry_is_refused(change: dict[str, object], words: str) -> None:
    good: dict[str, object] = {
        "a1_m": 0.3, "a2_m": 0.04, "b_m": 0.0, "c1_m": 0.7, "c2_m": 1.1, "c3_m": 1.0, "c4_m": 0.2,
        "offsets_rad": (0.0,) * 6, "signs": (1,) * 6,
    }  # fmt: skip
    with pytest.raises(InputError, match=words):
        catalog.from_opw("own", Opw(**(good | change)), LIMITS)  # type: ignore[arg-type]


def test_impossible_limits_compliances_and_masses_are_refused() -> None:
    opw = catalog.load(KR300).opw
    assert opw is not None
    with pytest.raises(InputError, match="axis 3"):
        catalog.from_opw("own", opw, np.array([*LIMITS[:2], [1.0, -1.0], *LIMITS[3:]]))
    with pytest.raises(InputError, match="negative"):
        catalog.from_opw("own", opw, LIMITS, -np.eye(6) * 1e-7)
    with pytest.raises(InputError, match="negative"):
        catalog.from_opw("own", opw, LIMITS, masses_kg=np.array([1.0, -1, 1, 1, 1, 1]))
    with pytest.raises(InputError, match="shape"):
        catalog.from_opw("own", opw, LIMITS, np.zeros((6, 3)))


def test_what_the_assumed_axes_of_the_kr_300_may_change_is_what_the_catalogue_says() -> None:
    """With k_B and k_C of a body exchanged, the deflections of the published load cases change as ``effect`` states."""
    robot, tool = catalog.load(KR300), load_cases.end_effector()
    chain = ElasticChain.build(robot, tool)
    figures = []
    for body in ("arm", "link_arm"):
        other = chain.compliance.copy()
        i = chain.names.index(body)
        other[i, [3, 4]] = other[i, [4, 3]]
        changed = replace(chain, compliance=other)
        change = []
        for case in load_cases.cases():
            q = inverse.inverse_all(chain, case.T_base_tcp)[0].q
            d, e = ((compliance.cartesian_compliance(c, q) @ case.w_tcp_base)[:3] for c in (chain, changed))
            change.append(np.linalg.norm(e - d) / np.linalg.norm(d))
        figures += [f"{100 * np.mean(change):.0f}", f"{100 * np.max(change):.0f}"]
    effect = catalog.entry(KR300).sources["stiffness_links"].effect
    assert re.findall(r"\d+", effect.partition("change by ")[2]) == figures
