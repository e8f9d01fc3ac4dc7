"""The demonstration's cell as faults are injected into it: cell, sensor, loop, and what its robot shows."""

from __future__ import annotations

import dataclasses
import functools
from importlib import resources
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.online import OnlineTable
from counterflex.geometry import pose, rotation
from counterflex.protocols.session.senses import Sensing
from counterflex.protocols.session.session import OnlineSession, SessionChecks
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.settings import ForceMode, OnlineSettings
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.twin.devices.commanded_motion import Report
from counterflex_lab.devices import COUNTS, FakeRsi, NetftLink, RsiConfig, RsiLink, Scaling, read_config

Q: Final = np.radians([0.0, -90.0, 120.0, 0.0, 30.0, 0.0])
PERIOD_S: Final = 4e-3
_STEPS: Final = 500


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


@functools.cache
def _path() -> Float:
    """(n, 4, 4) poses of the path, part frame."""
    out: Float = np.tile(pose.make(rotation.about_x(np.pi), np.array([0.05, 0.0, 0.0])), (_STEPS, 1, 1))
    out[:, 0, 3] += 1e-4 * np.arange(_STEPS)
    return out


@functools.cache
def _program_base() -> Float:
    """(4, 4) BASE of the program in the robot base: the path begins at the angles :data:`Q`."""
    out: Float = forward(demo_cell().controller_chain, Q) @ pose.inverse(_path()[0])
    return out


@functools.cache
def _angles() -> Float:
    """(n, 6) rad, angles of the path, by the geometry that its controller computes with."""
    return inverse_path(demo_cell().controller_chain, _program_base() @ _path(), Q).q


@functools.cache
def _in_part() -> Float:
    """(n, 4, 4) the same poses in the part frame of the cell file."""
    out: Float = pose.inverse(demo_cell().T_base_part) @ _program_base() @ _path()
    return out


def reported(
    robot: FakeRsi, cycle: int, running: bool, run_cycles: int | None = None, *, of_cell: bool = False
) -> Report:
    """Report of a robot on a straight path that follows its correction at once.

    Args:
        robot: Its controller.
        cycle: Number of the cycle.
        running: The program runs.
        run_cycles: Cycles in which the robot went on; None: all of them. It begins anew every 50 mm.
        of_cell: The program's BASE is the cell's part frame; else it is one in which the path runs along x.
    """
    at = (cycle if run_cycles is None else run_cycles) % _STEPS
    T = (_in_part() if of_cell else _path())[at]
    q = _angles()[at]
    corrected, offset = T.copy(), robot.pose_correction()
    corrected[:3, 3] += offset[:3]
    if offset[3:].any():
        corrected[:3, :3] = rotation.exp(offset[3:]) @ T[:3, :3]
    return Report(cycle * PERIOD_S, T, corrected, q, q, running, False)


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
        chosen: Other arguments of :class:`OnlineSession` and fields of :class:`Sensing`.
    """
    cell = demo_cell()
    loop = Loop(cell.chain, settings, cell.T_base_part, plan)
    angles = AxisCheck(cell.controller_chain, _program_base(), settings.period_s, OnlineTable().axis_tolerance)
    senses: dict[str, Any] = {"force": force, "angles": angles, "wrench": _sensor_wrench(cell)}
    senses |= {field.name: chosen.pop(field.name) for field in dataclasses.fields(Sensing) if field.name in chosen}
    session = OnlineSession(link, loop, sensing=Sensing(**senses), **{"checks": SessionChecks(), **chosen})
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
