"""Chains that several tests of this room share."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.geometry import pose, rotation
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model import catalog, load_cases
from counterflex.robot.model.description import EndEffector, Robot, Segment


@pytest.fixture(scope="session")
def haehn() -> ElasticChain:
    """KR 300 R2500 ultra with the massless sensor and holder of Haehn2020."""
    return ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"), load_cases.end_effector())


@pytest.fixture(scope="session")
def heavy() -> ElasticChain:
    """The same with masses in the end effector and with translational compliance, hung from a tilted base."""
    robot = catalog.load("kuka_kr300_r2500_ultra")
    soft = np.array([2e-8, 1e-8, 3e-8, 5e-6, 1e-5, 8e-6])
    tool = EndEffector(
        (
            Segment(
                "sensor", pose.make(p=np.array([0.0, 0.0, 0.03])), mass_kg=11.0, p_seg_com=np.array([0, 0.01, 0.02])
            ),
            Segment(
                "spindle",
                pose.make(rotation.exp(np.array([0.3, -0.2, 0.5])), np.array([0.02, 0.0, 0.05])),
                compliance=soft,
                mass_kg=75.0,
                p_seg_com=np.array([0.12, 0.03, 0.07]),
            ),
        ),
        pose.make(rotation.about_y(1.2), np.array([0.24, 0.05, 0.07])),
    )
    return ElasticChain.build(robot, tool, gravity_base=(1.0, -0.5, -9.7))


@pytest.fixture(scope="session")
def crooked() -> ElasticChain:
    """A chain without any right angle: all six directions elastic at nine segments, masses everywhere."""
    rng = np.random.default_rng(7)
    segments = []
    joint = 0
    for i in range(9):
        driven = i not in (2, 5, 8)
        segments.append(
            Segment(
                f"s{i}",
                pose.make(rotation.exp(rng.normal(size=3)), rng.uniform(-0.5, 0.5, 3)),
                joint=joint if driven else None,
                sign=float(rng.choice([-1.0, 1.0])),
                offset_rad=float(rng.normal()),
                compliance=rng.uniform(0.0, 1.0, 6) * [3e-8, 3e-8, 3e-8, 4e-7, 4e-7, 4e-7],
                mass_kg=float(rng.uniform(10.0, 80.0)),
                p_seg_com=rng.normal(size=3) * 0.1,
            )
        )
        joint += driven
    limits = np.array([[-3.0, 3.0]] * 6)
    T = pose.make(rotation.exp(rng.normal(size=3)), rng.uniform(-0.3, 0.3, 3))
    return ElasticChain.build(Robot("crooked", tuple(segments), T, limits))


@pytest.fixture(scope="session")
def poses() -> Float:
    """(400, 6) rad, angles of a KUKA-like robot at work, away from singularities."""
    rng = np.random.default_rng(3)
    return rng.uniform([-1.5, -2.0, 1.2, -2.5, 0.5, -3.0], [1.5, -1.2, 2.2, 2.5, 1.6, 3.0], (400, 6))


@pytest.fixture(scope="session")
def wrenches() -> Float:
    """(400, 6) N, N m."""
    return np.random.default_rng(4).uniform(-1.0, 1.0, (400, 6)) * [800.0, 800.0, 800.0, 20.0, 20.0, 20.0]
