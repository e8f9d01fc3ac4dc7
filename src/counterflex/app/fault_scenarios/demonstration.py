"""The demonstration's cell as faults are injected into it: cell, sensor, loop, and what its robot shows."""

from __future__ import annotations

import functools
from importlib import resources
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.files.cell import Cell, read_cell
from counterflex.geometry import pose, rotation
from counterflex.links.netft_link import NetftLink
from counterflex.links.rsi_link import RsiLink
from counterflex.links.session import OnlineSession, SessionChecks
from counterflex.robot.chain import forward
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.sensor_wrench import SensorWrench
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.twin.commanded_motion import Report
from counterflex.twin.fake_rsi import FakeRsi
from counterflex.twin.netft_server import COUNTS
from counterflex.wire.netft import Scaling
from counterflex.wire.rsi_config import RsiConfig, read_config

Q: Final = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
PERIOD_S: Final = 4e-3


@functools.cache
def demo_cell() -> Cell:
    """The demonstration cell."""
    with resources.as_file(resources.files("counterflex.app") / "demo" / "cell.toml") as file:
        return read_cell(file)


@functools.cache
def demo_config() -> RsiConfig:
    """Its RSI configuration."""
    with resources.as_file(resources.files("counterflex.app") / "demo" / "rsi.xml") as file:
        return read_config(file)


@functools.cache
def standing() -> Float:
    """(4, 4) tool in the part frame at the angles :data:`Q`, by the geometry that its controller computes with."""
    cell = demo_cell()
    out: Float = pose.inverse(cell.T_base_part) @ forward(cell.controller_chain, Q)
    return out


def reported(robot: FakeRsi, cycle: int, running: bool, gone: int | None = None) -> Report:
    """What a robot on a straight path shows that follows its correction at once.

    Args:
        robot: Its controller.
        cycle: Number of the cycle.
        running: The program runs.
        gone: Cycles in which the robot went on; None: all of them. It begins anew every 50 mm.
    """
    T = pose.make(
        rotation.about_x(np.pi), np.array([0.05 + 1e-4 * ((cycle if gone is None else gone) % 500), 0.0, 0.0])
    )
    corrected, offset = T.copy(), robot.pose_correction()
    corrected[:3, 3] += offset[:3]
    if offset[3:].any():
        corrected[:3, :3] = rotation.exp(offset[3:]) @ T[:3, :3]
    return Report(cycle * PERIOD_S, T, corrected, Q, Q, running, False)


def force_only(**changes: Any) -> OnlineSettings:
    """Settings of a loop that undoes the measured force, all of it, within the default limits; it needs no plan.

    Args:
        changes: Of other settings.
    """
    return OnlineSettings(force=ForceMode.MEASURED, normal_only=False, **changes)


def sensor_link(address: tuple[str, int]) -> NetftLink:
    """Link to a simulated sensor, subscribed."""
    link = NetftLink(address, Scaling(1.0 / COUNTS, 1.0 / COUNTS, 1000, "Net F/T"))
    link.start()
    return link


def _sensor_wrench(cell: Cell) -> SensorWrench:
    """A sensor in the demonstration's end effector that carries no weight and has no bias."""
    return SensorWrench(cell.chain, FlangeSensor("sensor", np.eye(4), 0.0, np.zeros(3)), cell.T_base_part)


def open_session(
    link: RsiLink, force: NetftLink, settings: OnlineSettings, *, plan: LoopPlan | None = None, **chosen: Any
) -> OnlineSession:
    """The loop of the demonstration's cell, compiled and at its beginning.

    Args:
        link: To the robot.
        force: To the sensor.
        settings: Of the loop.
        plan: What was planned, or None.
        chosen: Other arguments of :class:`OnlineSession`.
    """
    cell = demo_cell()
    loop = Loop(cell.chain, settings, cell.T_base_part, plan)
    parts = {"force": force, "wrench": _sensor_wrench(cell), "checks": SessionChecks(), **chosen}
    session = OnlineSession(link, loop, **parts)
    loop.run()
    loop.reset()
    return session


@functools.cache
def sensor_reading() -> Float:
    """(6, 6) reading of the sensor for a wrench on the tool, part axes."""
    wrench = _sensor_wrench(demo_cell())
    out: Float = np.zeros((6, 6))
    for k in range(6):
        wrench.w_base[:] = 0.0
        out[:, k] = wrench(Q, np.eye(6)[k])
    inverse: Float = np.asarray(np.linalg.inv(out), dtype=np.float64)
    return inverse
