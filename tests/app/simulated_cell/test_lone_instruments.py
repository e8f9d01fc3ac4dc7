"""Instruments alone on real loopback sockets, their clock a virtual one: what arrives, and what faults make of it."""

from __future__ import annotations

import itertools
import socket
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.run.tracker_replay import run_log_as_tracker
from counterflex.app.simulated_cell.instruments import InstrumentClock, LoneForce, LoneTracker
from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, OutputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.logs.run_log import RunLogWriter
from counterflex.geometry import pose, rotation
from counterflex.integrations.ati.link import telegram as netft
from counterflex.integrations.ati.link.link import NetftLink, fetch_scaling
from counterflex.integrations.ati.simulated import NetftServer
from counterflex.protocols.session.senses import tracker_frames
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.protocols.tracker.telegram import BEAM_BROKEN, INACCURATE, TrackerPose, read_pose
from counterflex.runtime.record_ring import COLUMNS
from counterflex.twin.devices.datagram_sender import TrackerSender, keep_pace
from counterflex.twin.devices.force_device import ForceDevice, ForceStart
from counterflex.twin.devices.pose_source import CircleTarget, NoisyPose, SquareTarget, StandingTarget, TrackerLog
from counterflex.twin.devices.wrench_source import NoisyWrench, RecordedWrench, SteadyWrench
from counterflex.twin.network.faults import Fault, FaultSchedule

STEADY = SteadyWrench(np.array([10.0, 0.0, -50.0, 0.0, 1.0, 0.0]), np.zeros(6))
CELL = Path(__file__).resolve().parents[3] / "examples" / "cells" / "kr300_d16_small.toml"


class VirtualClock:
    """Time that passes only while somebody waits; then it does what it is told."""

    def __init__(self, meanwhile: Callable[[float], None] = lambda _: None) -> None:
        self.time_s = 0.0
        self._meanwhile = meanwhile

    def clock(self) -> InstrumentClock:
        return InstrumentClock(lambda: self.time_s, self._wait)

    def _wait(self, seconds: float) -> None:
        self.time_s += seconds
        self._meanwhile(self.time_s)


def records(
    faults: tuple[Fault, ...] = (), count: int = 100, seed: int = 1
) -> tuple[list[netft.NetftRecord], NetftServer]:
    """What a client gets of a sensor that shows a steady load."""
    server = NetftServer(http_port=None, faults=FaultSchedule(faults, seed))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.connect(server.address)
        client.send(netft.request(netft.START))
        client.setblocking(False)
        found = []
        for k in range(count):
            server.poll()
            server.send(STEADY(0.0) + 1e-3 * (k % 7), k * 1e-3)
            while True:
                try:
                    data = client.recv(2048)
                except BlockingIOError:
                    break
                if len(data) == netft.RECORD.size:
                    sequence, sample, status, *counts = netft.RECORD.unpack(data)
                    found.append(netft.NetftRecord(sequence, sample, status, tuple(counts)))
    server.close()
    return found, server


def test_a_sensor_alone_is_read_by_the_link_as_a_real_one() -> None:
    read: dict[str, Any] = {}

    def started(device: ForceDevice) -> None:
        assert device.address is not None
        assert device.http_address is not None
        read["link"] = NetftLink(device.address, fetch_scaling("127.0.0.1", device.http_address[1]))
        read["link"].start()

    clock = VirtualClock(lambda _: None)
    source = NoisyWrench(STEADY, 0.5, 0.05, seed=3)
    found = LoneForce("netft", source, ForceStart(rate_hz=7000), 0.02).run(started=started, clock=clock.clock())
    link = read["link"]
    assert link.drain() == found["records"] == found["samples"] == 140
    assert found["ended"] == "finished"
    sigma = np.array([0.5] * 3 + [0.05] * 3) / np.sqrt(140)
    assert np.all(np.abs(link.w_sensor - STEADY(0.0)) < 5.0 * sigma)
    assert (link.lost, link.bad, link.malformed) == (0, 0, 0)
    link.close()


def test_a_rate_out_of_range_and_a_taken_port_are_refused() -> None:
    with pytest.raises(InputError, match="rate of an instrument"):
        LoneForce("netft", STEADY, ForceStart(rate_hz=8000)).run()
    server = NetftServer(http_port=None)
    with pytest.raises(OutputError, match="port cannot be opened"):
        LoneForce("netft", STEADY, ForceStart(port=server.address[1])).run()
    server.close()


def test_the_sensor_saturates_freezes_and_says_its_status() -> None:
    found, _ = records(
        (
            Fault("saturated", first=10, count=2),
            Fault("frozen", first=20, count=9),
            Fault("status", first=40, count=1, bits=0x80020000),
            Fault("offset", first=50, count=1, offset=(5.0, 0.0, 0.0)),
        )
    )
    assert len(found) == 100
    assert [k for k, r in enumerate(found) if r.status not in (netft.GOOD, netft.MONITOR)] == [10, 11, 40]
    assert found[10].counts[2] == -(2**31 - 1)
    assert len({r.counts for r in found[19:29]}) == 1
    assert len({r.counts for r in found[29:36]}) > 1
    assert found[40].status == 0x80020000
    assert found[50].counts[0] - found[50 - 7].counts[0] == 5_000_000


def test_the_sensor_is_silent_jumps_and_dies() -> None:
    found, server = records(
        (
            Fault("silent", from_s=0.010, for_s=0.005),
            Fault("counter", from_s=0.020, step=50),
            Fault("dying", from_s=0.050),
        )
    )
    assert server.dead
    assert len(found) == 45
    gaps = [b.sequence - a.sequence - 1 for a, b in itertools.pairwise(found)]
    assert [g for g in gaps if g] == [50]  # a silence leaves no gap: nothing was numbered
    assert found[10].sample - found[9].sample == 6


def test_records_are_lost_repeated_and_damaged_on_the_way() -> None:
    found, _ = records((Fault("lost", share=0.3), Fault("repeated", share=0.2)))
    sequences = [r.sequence for r in found]
    assert len(set(sequences)) < 85
    assert len(sequences) > len(set(sequences))
    shorter, _ = records((Fault("truncated", share=0.5),))
    assert 20 < len(shorter) < 80


def test_a_lost_request_starts_nothing() -> None:
    found, _ = records((Fault("lost", direction="in"),))
    assert found == []


def test_a_recorded_load_is_played_back() -> None:
    w = np.arange(18.0).reshape(3, 6)
    once = RecordedWrench(np.array([5.0, 6.0, 8.0]), w)
    assert once(0.5) == pytest.approx(0.5 * (w[0] + w[1]))
    assert once(2.0) == pytest.approx(0.5 * (w[1] + w[2]))
    assert once(99.0) == pytest.approx(w[2])
    assert RecordedWrench(once.time_s, w, repeat=True)(3.5) == pytest.approx(once(0.5))
    sine = SteadyWrench(np.zeros(6), np.ones(6), 2.0)
    assert sine(0.125) == pytest.approx(np.ones(6))


def sent(settings: dict[str, Any]) -> tuple[list[TrackerPose], dict[str, Any]]:
    """Datagrams of a tracker alone that can be read, and its summary."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        listener.bind(("127.0.0.1", 0))
        summary = LoneTracker(listener.getsockname(), **settings).run(clock=VirtualClock().clock())
        listener.setblocking(False)
        found = []
        while True:
            try:
                found.append(read_pose(listener.recv(2048)))
            except BlockingIOError:
                return found, summary
            except CounterflexError:
                continue


def test_a_circle_is_a_circle_at_its_feed() -> None:
    T = pose.make(rotation.from_zyx(np.array([0.3, 0.2, 0.1])), np.array([3.0, 0.0, 0.5]))
    found, _ = sent({"source": CircleTarget(T, 0.15, 0.7 / 60.0), "rate_hz": 100, "seconds": 1.0})
    p = np.array([one.T_tracker_target[:3, 3] for one in found])
    assert len(found) == 100
    assert np.linalg.norm(p - T[:3, 3], axis=1) == pytest.approx(np.full(100, 0.15), abs=1e-9)
    assert np.linalg.norm(np.diff(p, axis=0), axis=1) == pytest.approx(np.full(99, 0.7 / 60.0 / 100), rel=1e-6)
    assert [one.sequence for one in found] == list(range(1, 101))
    assert found[1].time_ns - found[0].time_ns == 10_000_000


def test_a_square_turns_at_its_corners_only() -> None:
    square = SquareTarget(np.eye(4), 0.4, 0.1)
    corners = [square(4.0 * k)[:2, 3] for k in range(5)]
    assert corners == pytest.approx(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2]]))
    assert square(2.0)[:2, 3] == pytest.approx([0.0, -0.2])


def test_noise_has_the_size_it_is_given() -> None:
    noisy = NoisyPose(StandingTarget(np.eye(4)), 20e-6, 1e-4, seed=2)
    T = np.array([noisy(0.0) for _ in range(2000)])
    assert np.std(T[:, :3, 3]) == pytest.approx(20e-6, rel=0.05)
    assert np.std(rotation.log(T[:, :3, :3])) == pytest.approx(1e-4, rel=0.05)


LOG = TrackerLog(
    (1000, 5_000_000_000, 9_000_000_000),
    np.stack([pose.make(p=np.array([3.0, 0.1 * k, 0.0])) for k in range(3)]),
    (0, BEAM_BROKEN, 0),
    (15e-6, 15e-6, 20e-6),
)


def test_a_log_is_replayed_by_its_own_clock() -> None:
    clock = VirtualClock()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        LoneTracker(listener.getsockname(), log=LOG, speed=2.0).run(clock=clock.clock())
    assert clock.time_s == pytest.approx((9.0 - 1e-6) / 2.0)
    found, summary = sent({"log": LOG})
    assert summary["measurements"] == 3
    assert [one.time_ns for one in found] == list(LOG.time_ns)
    assert [one.status for one in found] == [0, BEAM_BROKEN, 0]
    assert found[1].T_tracker_target[1, 3] == found[0].T_tracker_target[1, 3]  # broken: the last pose again
    assert found[2].T_tracker_target == pytest.approx(LOG.Ts_tracker_target[2])
    assert found[2].sigma_m == pytest.approx(20e-6)


def test_a_log_repeats_with_its_clock_going_on_and_off() -> None:
    found, _ = sent({"log": LOG, "repeat": True, "seconds": 20.0})
    stamps = [one.time_ns for one in found]
    assert len(stamps) == 5
    assert all(b > a for a, b in itertools.pairwise(stamps))
    shifted, _ = sent({"log": LOG, "clock_offset_s": 0.5, "clock_drift_ppm": 100.0})
    assert [one.time_ns - own for one, own in zip(shifted, LOG.time_ns, strict=True)] == pytest.approx(
        [500_000_000, 500_500_000, 500_900_000], abs=2
    )


def test_the_tracker_breaks_its_beam_and_comes_back_on_another_reflector() -> None:
    faults = FaultSchedule(
        (
            Fault("beam_broken", from_s=0.010, for_s=0.005),
            Fault("offset", from_s=0.015, for_s=0.005, offset=(0.0, 1e-3, 0.0)),
            Fault("status", from_s=0.030, for_s=0.001, bits=INACCURATE),
            Fault("frozen", from_s=0.040, for_s=0.005),
            Fault("counter", from_s=0.060, step=9),
        )
    )
    source = CircleTarget(np.eye(4), 0.1, 0.1)
    found, _ = sent({"source": source, "seconds": 0.1, "faults": faults})
    assert [k for k, one in enumerate(found) if one.status & BEAM_BROKEN] == [10, 11, 12, 13, 14]
    assert [k for k, one in enumerate(found) if one.status & INACCURATE] == [30]
    off = [one.T_tracker_target[1, 3] - source(k * 1e-3)[1, 3] for k, one in enumerate(found)]
    assert off[15:20] == pytest.approx([1e-3] * 5, abs=1e-9)
    assert off[20:30] == pytest.approx([0.0] * 10, abs=1e-9)
    assert len({one.T_tracker_target[1, 3] for one in found[39:45]}) == 1
    assert found[60].sequence - found[59].sequence == 10


def test_not_a_number_never_gets_past_the_link() -> None:
    link = TrackerLink()
    sender = TrackerSender(link.address, FaultSchedule((Fault("nan", first=3, count=2), Fault("dying", first=6))))
    for k in range(8):
        sender.send(pose.make(p=np.array([0.001 * k, 0.0, 0.0])), k * 1e-3)
    assert link.drain()
    assert link.malformed == 2
    assert link.lost == 2
    assert link.T_tracker_target[0, 3] == pytest.approx(0.005)
    assert sender.dead
    sender.close()
    link.close()


def test_a_fault_that_the_instrument_cannot_show_is_refused() -> None:
    with pytest.raises(InputError, match="a force sensor cannot show this fault"):
        NetftServer(faults=FaultSchedule((Fault("nan"),)))
    with pytest.raises(InputError, match="a tracker cannot show this fault"):
        TrackerSender(("127.0.0.1", 9), FaultSchedule((Fault("saturated"),)))


def test_an_instrument_that_was_held_up_gives_up_samples() -> None:
    clock = VirtualClock()
    ticks = []

    def tick(index: int, time_s: float) -> bool:
        ticks.append(index)
        if index == 10:
            clock.time_s += 0.5  # held up
        return index < 700

    given_up = keep_pace((k * 1e-3 for k in range(1000)), tick, now=clock.clock().now, wait=clock.clock().wait)
    assert given_up == 399
    assert ticks[:12] == [*range(11), 410]


def test_what_a_run_logged_of_its_tracker_is_what_the_tracker_had_sent(tmp_path: Path) -> None:
    text = CELL.read_text() + "\n[tracker]\nx_mm = 4000.0\na_deg = 170.0\ntarget_z_mm = 40.0\ntarget_b_deg = 5.0\n"
    (tmp_path / "cell.toml").write_text(text)
    cell = read_cell(tmp_path / "cell.toml")
    assert cell.tables.tracker is not None
    T_part_tracker, T_target_tcp = tracker_frames(
        cell.T_base_part, cell.tables.tracker.T_base_tracker, cell.tables.tracker.T_on_target
    )
    true = [pose.make(rotation.from_zyx(np.array([0.1, 0.2, 0.1 * k])), np.array([3.0, 0.1 * k, 0.5])) for k in (1, 2)]
    rows: Float = np.zeros((4, len(COLUMNS)))
    for k, row in enumerate(rows):
        T_part_tcp = T_part_tracker @ true[min(k // 2, 1)] @ T_target_tcp
        at = COLUMNS.index("actual_R00")
        row[at : at + 12] = np.r_[T_part_tcp[:3, :3].ravel(), T_part_tcp[:3, 3]]
        row[COLUMNS.index("flag_tracker_new")] = k % 2 == 0
        row[COLUMNS.index("received_ns")] = 1_000_000 * (k + 1)
    log = RunLogWriter(tmp_path / "log", {})
    log.add(rows)
    log.close()
    found = run_log_as_tracker(tmp_path / "log", tmp_path / "cell.toml")
    assert found.time_ns == (1_000_000, 3_000_000)
    assert found.Ts_tracker_target == pytest.approx(np.array(true), abs=1e-12)
    with pytest.raises(FileFormatError, match="the cell has no tracker"):
        run_log_as_tracker(tmp_path / "log", CELL)


def test_a_stream_of_records_is_what_the_sensor_would_send() -> None:
    """Against the published layout, not against our own reader."""
    server = NetftServer(http_port=None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.sendto(bytes.fromhex("1234000200000001"), server.address)
        server.poll()
        server.send(np.array([1.0, -2.0, 3.0, 0.01, -0.02, 0.03]))
        data = client.recv(2048)
    server.close()
    assert struct.unpack(">III6i", data) == (1, 1, 0, 1000000, -2000000, 3000000, 10000, -20000, 30000)
