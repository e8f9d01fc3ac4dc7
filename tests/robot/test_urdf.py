"""URDF import: Pinocchio as oracle, closed-form fit, everything that is not a serial six-axis robot refused."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from counterflex.core import remarks
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain, forward, frames
from counterflex.robot.kinematics.inverse import inverse, inverse_all
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Robot
from counterflex.robot.model.urdf import fit_opw, flange_pose, load_urdf


def joint_xml(
    k: int, T: Float, axis: Float, *, kind: str = "revolute", extra: str = "", limit: str | None = None
) -> str:
    if limit is None:
        limit = f'<limit lower="{-2.0 - 0.1 * k}" upper="{2.0 + 0.2 * k}" velocity="{1.0 + k}" effort="100"/>'
    return (
        f'<joint name="joint_{k}" type="{kind}"><parent link="link_{k - 1}"/><child link="link_{k}"/>'
        f'{origin_xml(T)}<axis xyz="{numbers(axis)}"/>{limit}{extra}</joint>'
    )


def numbers(values: Float) -> str:
    return " ".join(repr(float(v)) for v in values)


def origin_xml(T: Float) -> str:
    return f'<origin xyz="{numbers(T[:3, 3])}" rpy="{numbers(rotation.to_zyx(T[:3, :3])[::-1])}"/>'


def link_xml(k: int, mass: float = 0.0) -> str:
    inertial = (
        f'<inertial><origin xyz="0.1 {0.01 * k} -0.2" rpy="0.3 0 0"/><mass value="{mass}"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    )
    return f'<link name="link_{k}">{inertial if mass else ""}</link>'


def robot_xml(joints: list[str], *, tip: Float | None = None) -> str:
    box = '<inertial><mass value="5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = "".join(link_xml(k, 10.0 * k) for k in range(7)) + f'<link name="tool0"/><link name="box">{box}</link>'
    fixed = (
        '<joint name="flange" type="fixed"><parent link="link_6"/><child link="tool0"/>'
        f"{origin_xml(np.eye(4) if tip is None else tip)}</joint>"
        '<joint name="bolt" type="fixed"><parent link="link_3"/><child link="box"/><origin xyz="0.5 0 0"/></joint>'
    )
    return f'<?xml version="1.0"?><robot name="generated">{links}{"".join(joints)}{fixed}</robot>'


def as_urdf(robot: Robot, rng: np.random.Generator) -> str:
    """The robot with every joint frame turned at random, controller signs and offsets in axes and origins."""
    joints, carry = [], np.eye(4)
    for segment in robot.segments:
        assert segment.joint is not None
        R = rotation.exp(rng.normal(0.0, 1.0, 3))
        turned = pose.make(rotation.about_z(segment.offset_rad) @ R)
        axis = segment.sign * R.T[:, 2]
        joints.append(joint_xml(segment.joint + 1, carry @ segment.T_prev_seg @ turned, axis))
        carry = pose.make(R.T)
    return robot_xml(joints, tip=carry @ robot.T_last_flange)


def bare(name: str) -> Robot:
    opw = catalog.load(name).opw
    assert opw is not None
    return catalog.from_opw(name, opw, np.tile([-3.0, 3.0], (6, 1)))


def random_robot(rng: np.random.Generator) -> str:
    joints = []
    for k in range(1, 7):
        axis = rng.normal(0.0, 1.0, 3)
        T = pose.make(rotation.exp(rng.normal(0.0, 1.0, 3)), rng.uniform(-0.5, 0.5, 3))
        joints.append(joint_xml(k, T, axis))
    return robot_xml(joints, tip=pose.make(rotation.exp(rng.normal(0.0, 1.0, 3)), rng.uniform(-0.3, 0.3, 3)))


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000))
def test_kinematics_and_centre_of_gravity_equal_pinocchio(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    file = tmp_path / f"robot{seed}.urdf"
    file.write_text(random_robot(rng))
    robot = load_urdf(file)
    chain = ElasticChain.build(robot, None)
    model = pinocchio.buildModelFromUrdf(str(file))
    data = model.createData()
    tip = model.getFrameId("tool0")
    np.testing.assert_allclose(robot.joint_limits_rad[:, 0], model.lowerPositionLimit)
    np.testing.assert_allclose(robot.joint_limits_rad[:, 1], model.upperPositionLimit)
    assert robot.joint_speeds_rad_s is not None
    np.testing.assert_allclose(robot.joint_speeds_rad_s, model.velocityLimit)
    for _ in range(5):
        q = rng.uniform(-2.0, 2.0, 6)
        pinocchio.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(forward(chain, q), data.oMf[tip].homogeneous, rtol=0, atol=1e-12)
        centre = pinocchio.centerOfMass(model, data, q)
        Ts = frames(chain, q)
        com = [pose.transform(Ts[i], s.p_seg_com) for i, s in enumerate(robot.segments)]
        mass = np.array([s.mass_kg for s in robot.segments])
        np.testing.assert_allclose(mass @ np.array(com) / mass.sum(), centre, rtol=0, atol=1e-12)
    assert sum(s.mass_kg for s in robot.segments) == pytest.approx(10 + 20 + 30 + 40 + 50 + 60 + 5)


@pytest.mark.parametrize(
    "name",
    ["kuka_kr300_r2500_ultra", "kuka_kr210_r2700_2", "abb_irb120", "abb_irb6640_185_280", "staubli_tx2_90l"],
)
def test_closed_form_is_found_behind_any_frames(tmp_path: Path, name: str) -> None:
    robot = bare(name)
    assert robot.opw is not None
    file = tmp_path / "robot.urdf"
    file.write_text(as_urdf(robot, np.random.default_rng(3)))
    read = load_urdf(file)
    assert read.opw is not None
    lengths = ("a1_m", "a2_m", "b_m", "c1_m", "c2_m", "c3_m", "c4_m")
    for length in lengths:
        assert getattr(read.opw, length) == pytest.approx(getattr(robot.opw, length), abs=1e-9)
    assert read.opw.signs == robot.opw.signs
    q = np.array([0.3, -0.9, 1.2, 0.4, 0.8, -0.5])
    T = flange_pose(robot.segments, robot.T_last_flange, q)
    chain = ElasticChain.build(read, None)
    np.testing.assert_allclose(forward(chain, q), T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(inverse(chain, T, q).q, q, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(
    zero=st.tuples(*[st.floats(-1.5, 1.5)] * 6),
    lengths=st.tuples(
        st.floats(0.0, 0.5), st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(0.2, 1.0),
        st.floats(0.3, 1.5), st.floats(0.3, 1.5), st.floats(0.05, 0.4),
    ),
    signs=st.tuples(*[st.sampled_from([-1, 1])] * 6),
)  # fmt: skip
def test_fit_reproduces_any_opw_arm_from_any_zero_pose(
    zero: tuple[float, ...], lengths: tuple[float, ...], signs: tuple[int, ...]
) -> None:
    a1, a2, b, c1, c2, c3, c4 = lengths
    opw = catalog.load("abb_irb120").opw
    assert opw is not None
    made = type(opw)(a1, a2, b, c1, c2, c3, c4, zero, signs)
    robot = catalog.from_opw("any", made, np.tile([-3.0, 3.0], (6, 1)))
    fitted = fit_opw(robot.segments, robot.T_last_flange)
    assert fitted is not None
    again = catalog.from_opw("again", fitted, np.tile([-3.0, 3.0], (6, 1)))
    q = np.array([0.7, -0.4, 0.9, 1.1, -0.8, 2.0])
    np.testing.assert_allclose(
        flange_pose(again.segments, again.T_last_flange, q),
        flange_pose(robot.segments, robot.T_last_flange, q),
        atol=1e-6,
    )


def test_geometry_that_is_not_opw_still_has_an_inverse(tmp_path: Path) -> None:
    robot = bare("kuka_kr300_r2500_ultra")
    text = as_urdf(robot, np.random.default_rng(5))
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    read = load_urdf(file)
    last = read.segments[-1]
    T = last.T_prev_seg @ pose.make(p=np.array([0.04, 0.03, 0.0]))  # axis 6 beside axis 5
    moved = (*read.segments[:-1], type(last)(last.name, T, last.joint))
    assert fit_opw(moved, read.T_last_flange) is None
    chain = ElasticChain.build(Robot("bent", moved, read.T_last_flange, np.tile([-2.5, 2.5], (6, 1))), None)
    q = np.array([0.3, -0.9, 1.2, 0.4, 0.8, -0.5])
    solutions = inverse_all(chain, forward(chain, q))
    assert min(np.abs(s.q - q).max() for s in solutions) < 1e-8


def test_base_and_tip_can_be_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    file = tmp_path / "robot.urdf"
    file.write_text(random_robot(rng))
    with pytest.raises(FileFormatError, match="six-axis robot"):
        load_urdf(file, tip_link="box")
    with pytest.raises(InputError, match="no link 'nowhere'"):
        load_urdf(file, tip_link="nowhere")
    with pytest.raises(InputError, match="is not connected to"):
        load_urdf(file, tip_link="link_0", base_link="link_2")
    assert load_urdf(file, "link_6", "link_0").name == "generated"


def broken(**change: str) -> str:
    """A good robot with joint 3 changed."""
    joints = [joint_xml(k, pose.make(p=np.array([0.1, 0.0, 0.3])), np.array([0.0, 0.0, 1.0])) for k in range(1, 7)]
    joints[2] = joint_xml(3, np.eye(4), np.array([0.0, 1.0, 0.0]), **change)
    return robot_xml(joints)


BRANCH = (
    '<link name="finger"/><joint name="grip" type="{kind}"><parent link="link_6"/><child link="finger"/>'
    '<axis xyz="1 0 0"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint>'
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (broken(kind="prismatic"), "does not turn"),
        (broken(kind="floating"), "does not turn"),
        (broken(kind="fixed"), "not a six-axis robot"),
        (broken(extra='<mimic joint="joint_2" multiplier="1" offset="0"/>'), "mimic"),
        (broken(limit=""), "without limits"),
        (broken(limit='<limit lower="1" upper="-1" velocity="1" effort="1"/>'), "not below"),
        (broken(limit='<limit lower="-180" upper="180" velocity="1" effort="1"/>'), "in rad"),
        (broken(limit='<limit lower="-1" upper="1" velocity="-1" effort="1"/>'), "speed limit"),
        (broken().replace("</robot>", BRANCH.format(kind="prismatic") + "</robot>"), "is outside the chain"),
        (broken().replace('<axis xyz="0.0 1.0 0.0"/>', '<axis xyz="0 0 0"/>'), "no direction"),
        (broken().replace('<mass value="30.0"/>', '<mass value="-30"/>'), "impossible mass"),
        (broken().replace('<child link="link_2"/>', '<child link="link_4"/>'), "two parents"),
        (broken().replace('<parent link="link_2"/>', '<parent link="ghost"/>'), "not there"),
        ("<robot name='x'><link name='a'></robot>", "well-formed"),
        ("hello", "well-formed"),
        ("", "well-formed"),
        ("<sdf/>", "URDF"),
    ],
)
def test_what_is_no_serial_six_axis_robot_is_refused(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    with pytest.raises((FileFormatError, InputError), match=words) as caught:
        load_urdf(file)
    assert "\n" not in str(caught.value)
    assert "robot.urdf" in str(caught.value)


def test_missing_file_and_missing_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        load_urdf(tmp_path / "nothing.urdf")

    def absent(name: str) -> ModuleType:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(InputError, match=r'pip install "counterflex\[urdf\]"'):
        load_urdf(tmp_path / "nothing.urdf")


def test_fixed_mounts_continuous_joints_and_rounded_angles(tmp_path: Path) -> None:
    """A fixed link may carry a plate; a continuous joint gets one turn each way."""
    text = broken(kind="continuous", limit="").replace("</robot>", BRANCH.format(kind="fixed") + "</robot>")
    file = tmp_path / "robot.urdf"
    file.write_text(text)
    with remarks.collected() as said:
        robot = load_urdf(file)
    assert [text.partition(": ")[2][:24] for text in said] == ["no speed of axis 3 is st"]
    np.testing.assert_allclose(robot.joint_limits_rad[2], [-2 * math.pi, 2 * math.pi])
    assert robot.joint_speeds_rad_s is None
    assert robot.opw is None
