"""Correcting an elastic robot over EGM, both ways, on real sockets in lockstep: worse without, better with."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.compensation.compensate import run as compensate
from counterflex.app.run import session as online_session
from counterflex.app.simulated_cell.alone import running_robot
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.sensing import flange_sensor
from counterflex.integrations.abb.alone import egm_controller
from counterflex.integrations.abb.link.guidance_link import EgmGuidanceLink
from counterflex.integrations.abb.link.path_link import EgmPathLink
from counterflex.integrations.abb.simulated import FakeEgm
from counterflex.protocols.processes.control_array import Request
from counterflex.protocols.session.session import OnlineSession
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.state.supervisor import State
from counterflex.twin.devices.commanded_motion import Report
from counterflex.twin.devices.exact_robot import ExactRobot
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.devices.robot_server import RobotServer, Timing

EGM = ("egm", None)
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
PROGRAM = EXAMPLES / "programs" / "groove.ngc"
"""Feed along +x at y = 15 mm, z = 34 mm, from x = -12 to 72 mm."""
COMPLIANCE_M_N = np.diag([1.5e-6, 2.0e-6, 0.8e-6])
PEAK_N = np.array([-60.0, 350.0, 120.0])
"""Force on the tool in part axes while it cuts."""
SENSOR = '\n[sensor]\nsegment = "sensor"\nmass_kg = 0.02\ncom_mm = [0, 0, 1]\n'
ONLINE = """
[online]
force = "measured"
period_ms = {period}
correction_mm = 3
speed_mm_s = 60
acceleration_mm_s2 = 5000
corner_hz = 8
average = 1
dead_ms = 12
natural_hz = 6
damping = 0.8

[egm]
mode = "{mode}"
"""


class Bending:
    """A robot that bends under a force which acts between x = 0 and 60 mm, with noise, and measures it itself."""

    def __init__(self, robot: ExactRobot, egm: FakeEgm, wrench: SensorWrench, seed: int) -> None:
        self._robot, self._egm, self._wrench = robot, egm, wrench
        self._noise = np.random.default_rng(seed)
        self.period_s = robot.period_s
        self.tip: list[Float] = []

    @property
    def finished(self) -> bool:
        return self._robot.finished

    @property
    def cycles(self) -> int:
        return self._robot.cycles

    def start(self) -> None:
        self._robot.start()

    def advance(
        self, cartesian: Float, axes: Float | None = None, override: float = 1.0, T_part_guided: Float | None = None
    ) -> Report:
        report = self._robot.advance(cartesian, axes, override, T_part_guided)
        p = report.T_part_actual[:3, 3]
        depth = 0.0
        if p[2] < 36e-3:
            depth = min(1.0, max(0.0, p[0] / 10e-3), max(0.0, (60e-3 - p[0]) / 10e-3))
        self.tip.append(p + COMPLIANCE_M_N @ (depth * PEAK_N))
        self._egm.force = self._reading(report.q_actual, depth * PEAK_N + self._noise.normal(0.0, 2.0, 3))
        return report

    def _reading(self, q: Float, force: Float) -> Float:
        """What the sensor shows of a force at the tip: the compensator's own map, turned round."""
        if len(self.tip) % 25 == 1:  # the arm turns little from one cycle to the next
            self._idle = self._wrench(q, np.zeros(6), 0.0).copy()
            shown = np.stack([self._wrench(q, e, 0.0).copy() for e in np.eye(6)], axis=1)
            self._from_part = np.linalg.inv(shown - self._idle[:, None])
        out: Float = self._from_part @ (np.r_[force, np.zeros(3)] - self._idle)
        return out


def mill(folder: Path, mode: str, *, arm: bool) -> tuple[Float, set[State], OnlineSession]:
    """Path of the bent tip while it cuts, states of the loop, and the session."""
    cell_file, plan = folder / f"{mode}.toml", folder / "plan" / "plan.parquet"
    cell = read_cell(cell_file)
    run = online_session.RunSettings(cell_file, EGM, plan, compensated=False, port=0, arm=arm, lockstep=True)
    session = online_session.open_session(run)
    sensor = flange_sensor(cell.tables.sensor, cell.chain)
    assert sensor is not None
    egm = egm_controller(cell)
    answer = PathAnswer(12e-3, 6.0, 0.8)
    wrench = SensorWrench(cell.chain, sensor, cell.T_base_part)
    plant = Bending(running_robot(cell, PROGRAM, egm.cycle_s, answer), egm, wrench, seed=3)
    gate = 140
    server = RobotServer(plant, egm, session.link.address, timing=Timing(gate_s=gate * egm.cycle_s))
    ended: list[str] = []
    thread = threading.Thread(target=lambda: ended.append(server.run(after=5)), daemon=True)
    session.control[Request.ARM] = int(arm)
    states = set()
    thread.start()
    try:
        while thread.is_alive():
            session.cycle(2.0 if not ended else 0.01)
            states.add(session.loop.state)
    finally:
        session.link.close()
        thread.join(10.0)
        server.close()
    assert ended == ["finished"]
    tip = np.array(plant.tip)
    return tip[(tip[:, 2] < 36e-3) & (tip[:, 0] > -2e-3) & (tip[:, 0] < 62e-3)], states, session


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("egm")
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    for mode, period in (("path", 24), ("pose", 4)):
        (out / f"{mode}.toml").write_text(text + SENSOR + ONLINE.format(period=period, mode=mode), encoding="utf-8")
    compensate(PROGRAM, out / "path.toml", out / "plan", report=False, programmed_feed=True)
    return out


@pytest.mark.parametrize("mode", ["path", "pose"])
def test_correcting_over_egm_pair(folder: Path, mode: str) -> None:
    """Same robot, same force, same seed: watched only, and corrected from the robot's own force."""
    before, watching, _ = mill(folder, mode, arm=False)
    after, acting, session = mill(folder, mode, arm=True)
    assert State.ACTIVE not in watching
    assert {State.ARMED, State.ACTIVE} <= acting
    assert State.FAULT not in acting
    assert isinstance(session.link, EgmPathLink if mode == "path" else EgmGuidanceLink)
    assert session.link.holds_feed is (mode == "pose")
    off = {}
    for name, tip in (("before", before), ("after", after)):
        off[name] = np.hypot(tip[:, 1] - 15e-3, tip[:, 2] - 34e-3)
        steady = off[name][(tip[:, 0] > 25e-3) & (tip[:, 0] < 45e-3)]
        off[f"{name} steady"] = steady
    bent = float(np.linalg.norm((COMPLIANCE_M_N @ PEAK_N)[1:]))
    assert off["before steady"].max() == pytest.approx(bent, rel=0.02)
    assert off["after"].max() < 0.7 * off["before"].max()
    assert off["after steady"].mean() < 0.45 * off["before steady"].mean()  # it bends more than the cell file says


def test_what_egm_cannot_do_is_refused(folder: Path, tmp_path: Path) -> None:
    text = (folder / "path.toml").read_text(encoding="utf-8")
    plan = folder / "plan" / "plan.parquet"

    def opened(old: str, new: str, **changes: object) -> None:
        cell = tmp_path / "cell.toml"
        assert old in text
        cell.write_text(text.replace(old, new), encoding="utf-8")
        settings = online_session.RunSettings(cell, EGM, plan, compensated=False, port=0)
        online_session.open_session(replace(settings, **changes))  # type: ignore[arg-type]

    with pytest.raises(InputError, match="another cycle"):
        opened("period_ms = 24", "period_ms = 4")
    with pytest.raises(InputError, match="square to the path"):
        opened("average = 1", "average = 1\norientation = true")
    with pytest.raises(InputError, match="no axis corrections"):
        opened("average = 1", 'average = 1\noutput = "axes"')
    with pytest.raises(InputError, match="protocol is not clear"):
        opened("average = 1", "average = 1", robot=None)
