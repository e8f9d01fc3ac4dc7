"""A simulated controller without a partner: one line, status 2, nothing written."""

from __future__ import annotations

import contextlib
import shutil
import socket
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import counterflex as package
from counterflex.app.proof.truth import make_truth
from counterflex.files.cell.cell import read_cell
from counterflex.geometry import pose
from counterflex.integrations.kuka import alone as simulated_rsi
from counterflex.integrations.kuka.link.config import read_config
from counterflex.integrations.kuka.link.telegram import answer_writer, robot_reader
from counterflex.integrations.kuka.simulated import FakeRsi, RsiContext
from counterflex.robot.elasticity.chain import forward
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.twin.devices import robot_server
from counterflex.twin.devices.exact_robot import StandingRobot, Standstill
from counterflex.twin.devices.robot_server import RobotServer

DEMO = Path(package.__file__).parent / "app" / "demo"


def free_port(kind: socket.SocketKind) -> str:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])


SAID = "no sensor program answers; got nothing for 0.1 s"


@pytest.mark.parametrize("somebody", [False, True])
def test_nobody_answers(folder: Path, refused: Any, counterflex: Any, somebody: bool) -> None:
    """With nobody at the port, and with somebody there who says nothing."""
    shutil.copy(DEMO / "rsi.xml", folder / "rsi.xml")
    make_truth(read_cell(folder / "cell.toml"), 1, folder / "truth.toml")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        peer = f"127.0.0.1:{silent.getsockname()[1] if somebody else free_port(socket.SOCK_DGRAM)}"
        where = ["-s", f"controller.peer={peer}", "-s", "controller.wait_s=0.1"]
        ports = ["-s", f"force_sensor.address=127.0.0.1:{free_port(socket.SOCK_DGRAM)}"]
        ports += ["-s", f"force_sensor.http_port={free_port(socket.SOCK_STREAM)}"]
        cell = ["part.ngc", "--cell", "cell.toml", "--truth", "truth.toml", "--rsi", "rsi.xml"]
        assert f"{peer}: {SAID}" in refused("twin", "cell", *cell, *ports, *where, "--out", "part")
        alone = counterflex("twin", "rsi", "rsi.xml", *where, "--seconds", "1", "--record", "seen.csv")
        assert (alone.status, alone.out) == (2, "")
        assert f"{peer}: {SAID}" in alone.err.splitlines()[-1]
        assert not (folder / "seen.csv").exists()


@pytest.fixture
def soon_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A partner counts as gone after 0.6 s in three waits, in place of 15 s: the same comparison, other numbers."""
    assert 3.0 * robot_server.Timing().patience_s == robot_server._LONGEST_ALONE_S
    monkeypatch.setattr(robot_server, "_LONGEST_ALONE_S", 0.6)
    whole = robot_server.RobotServer._wait_lockstep

    def brief(self: RobotServer, now_s: float) -> bytes | None:
        self.timing = replace(self.timing, patience_s=0.2)
        return whole(self, now_s)

    monkeypatch.setattr(robot_server.RobotServer, "_wait_lockstep", brief)


@pytest.mark.usefixtures("soon_alone")
def test_a_controller_ends_when_its_partner_has_gone() -> None:
    """One that would wait for ever by its own time-out: the port is closed after ten answers."""
    config = read_config(DEMO / "rsi.xml")
    partner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    partner.bind(("127.0.0.1", 0))
    fake = FakeRsi(config, RsiContext(timeout=10**6))
    server = RobotServer(StandingRobot(Standstill(np.eye(4), np.zeros(6), 1e6), 0.004), fake, partner.getsockname())
    reader, writer = robot_reader(config), answer_writer(config)

    def answer() -> None:
        for _ in range(10):
            data, peer = partner.recvfrom(65536)
            reader.read_bytes(data)
            partner.sendto(writer.telegram(reader.counter), peer)
        partner.close()

    answering = threading.Thread(target=answer, daemon=True)
    answering.start()
    assert server.run() == "no more answers from the sensor program"
    answering.join(20.0)
    assert server.cycles < 500
    server.close()


@pytest.mark.usefixtures("soon_alone")
def test_a_partner_that_vanishes_in_the_middle_is_no_success(folder: Path, counterflex: Any) -> None:
    """0 said that all was well; a Stop from the partner is an answer, and 0."""
    shutil.copy(DEMO / "rsi.xml", folder / "rsi.xml")
    config = read_config(folder / "rsi.xml")
    partner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    partner.bind(("127.0.0.1", 0))
    answering = threading.Thread(target=_answers, args=(partner, config, 10), daemon=True)
    answering.start()
    peer = f"127.0.0.1:{partner.getsockname()[1]}"
    alone = counterflex("twin", "rsi", "rsi.xml", "-s", f"controller.peer={peer}", "--seconds", "1")
    answering.join(20.0)
    assert alone.status == 3
    assert "no more answers from the sensor program" in alone.out


def _answers(partner: socket.socket, config: Any, most: int) -> None:
    reader, writer = robot_reader(config), answer_writer(config)
    with partner, contextlib.suppress(OSError):
        for _ in range(most):
            data, peer = partner.recvfrom(65536)
            reader.read_bytes(data)
            partner.sendto(writer.telegram(reader.counter), peer)


def test_where_a_robot_of_a_cell_stands_pose_and_angles_belong_together(folder: Path, refused: Any) -> None:
    """The pose was 0, whatever the angles: a loop that holds one against the other did not arm."""
    cell, q = read_cell(folder / "cell.toml"), np.radians([10.0, -80.0, 100.0, 5.0, 40.0, -20.0])
    robot = simulated_rsi.LoneRsi(rsi=DEMO / "rsi.xml", cell=folder / "cell.toml", q=q).robot()
    robot.start()
    report = robot.advance(np.zeros(6))
    expected = pose.inverse(cell.T_base_part) @ forward(cell.controller_chain, q)
    np.testing.assert_allclose(report.T_part_nominal, expected, atol=1e-12)
    np.testing.assert_allclose(report.T_part_actual, expected, atol=1e-12)
    np.testing.assert_array_equal(report.q_command, q)
    check = AxisCheck(cell.controller_chain, cell.T_base_part, 4e-3)
    shown, angles = np.r_[report.T_part_nominal[:3, :3].reshape(-1), report.T_part_nominal[:3, 3]], q.copy()
    causes = {check(angles, shown, np.zeros(6), learn=True, commanded_is=1) for _ in range(200)}
    assert causes == {0}
    shutil.copy(DEMO / "rsi.xml", folder / "rsi.xml")
    said = refused("twin", "rsi", "rsi.xml", "--cell", "cell.toml", "-s", "standstill.pose_mm_deg=1,2,3,0,0,0")
    assert "standstill.pose_mm_deg" in said
