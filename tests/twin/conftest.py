"""The reference cell of the twin's tests: KR 300 with sensor and spindle holder, tool 0.3 m beside the flange."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.robot.model import catalog
from counterflex.robot.model.description import EndEffector, Robot
from counterflex.twin.plant.controller import Controller, controller_of
from counterflex.twin.truth.nominal import nominal_truth
from counterflex.twin.truth.truth import CuttingTruth, Truth


@pytest.fixture(scope="session")
def robot() -> Robot:
    return catalog.load("kuka_kr300_r2500_ultra")


@pytest.fixture(scope="session")
def end_effector() -> EndEffector:
    elements = catalog.end_effector_elements()
    sensor = elements["haehn2020_sensor"].segment
    holder = elements["haehn2020_spindle_holder"].segment
    T_flange_holder = holder.T_prev_seg
    holder = replace(holder, T_prev_seg=pose.inverse(sensor.T_prev_seg) @ T_flange_holder)
    T_flange_tcp = np.array([[0.0, 0, 1, 0.3], [0, 1, 0, 0], [-1, 0, 0, 0.15], [0, 0, 0, 1]])
    return EndEffector((sensor, holder), pose.inverse(T_flange_holder) @ T_flange_tcp)


@pytest.fixture(scope="session")
def cutting() -> CuttingTruth:
    return CuttingTruth(k_pa=(800e6, 280e6, 120e6), exponent=(0.25, 0.25, 0.25))


@pytest.fixture(scope="session")
def truth(robot: Robot, end_effector: EndEffector, cutting: CuttingTruth) -> Truth:
    return nominal_truth(robot, end_effector, cutting)


@pytest.fixture(scope="session")
def weightless(truth: Truth) -> Truth:
    """The same without gravity, counterbalance and play, for comparison with linear closed forms."""
    drives = tuple(replace(d, dead_band_rad=0.0) for d in truth.drives)
    return replace(truth, gravity_base=np.zeros(3), counterbalance=None, drives=drives)


@pytest.fixture(scope="session")
def T_base_part() -> Float:
    return pose.make(p=np.array([1.6, 0.0, 1.1]))


@pytest.fixture(scope="session")
def controller(robot: Robot, end_effector: EndEffector, T_base_part: Float) -> Controller:
    return controller_of(robot, end_effector, T_base_part, rotation_about_tool_rad=np.pi)


@pytest.fixture(scope="session")
def poses_rad() -> Float:
    """Joint angles spread over the working space (the first is the stretched arm)."""
    degrees: Float = np.array(
        [
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, -92.5, 115.0, 180.0, 22.8, -180.0],
            [30.0, -70.0, 100.0, 40.0, 50.0, -60.0],
            [-20.0, -100.0, 110.0, -80.0, 70.0, 100.0],
        ]
    )
    return np.radians(degrees)
