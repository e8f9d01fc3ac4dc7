"""A telegram that cannot be read is answered by its counter, with the correction that stands, kernel or not."""

from __future__ import annotations

import socket

import numpy as np
import pytest

from counterflex.integrations.kuka.link.link import RsiLink
from counterflex.integrations.kuka.link.telegram import answer_reader
from counterflex.integrations.kuka.simulated import FakeRsi, RsiContext
from counterflex.protocols.system import system_calls
from counterflex.runtime.state.supervisor import State
from counterflex.twin.devices.commanded_motion import Report
from counterflex.twin.plant.drives import MotorCurrents
from counterflex_lab.composed import bench


@pytest.mark.parametrize("kernel", [True, False])
def test_an_unreadable_telegram_is_answered_once(kernel: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Systems without a call for many datagrams (Windows, macOS) counted it as answered, and it was not."""
    if not kernel:
        monkeypatch.setattr(system_calls, "THERE", False)
    config = bench.config(currents=True)
    device = FakeRsi(config, RsiContext(first_counter=1000), {"Enable": 0.0}, MotorCurrents(1))
    place = Report(0.0, np.eye(4), np.eye(4), np.zeros(6), np.zeros(6), cutting_program=False, finished=False)
    link = RsiLink(config, port=0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.bind(("127.0.0.1", 0))
        robot.settimeout(2.0)
        try:
            robot.sendto(device.telegram(place), link.address)
            assert link.wait(1.0)
            assert link.answer(np.array([1e-4, 0.0, 0.0, 0.0, 0.0, 0.0]), feed_hold=True, state=State.HOLD)
            robot.recv(10_000)
            data = device.telegram(place)
            begin = data.index(b"<MACur")
            robot.sendto(data[:begin] + data[data.index(b">", begin) + 1 :], link.address)
            assert not link.wait(0.05)
            answer = answer_reader(config)
            assert answer.read_bytes(robot.recv(10_000)) == 0
            assert answer.counter == device.counter
            assert answer.values[answer.place("RKorr.X", "FeedHold")] == pytest.approx([0.1, 1.0])
            assert (link.counters.malformed, link.counters.repeated) == (1, 1)
        finally:
            link.close()
