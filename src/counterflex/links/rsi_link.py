"""The sensor program's side of KUKA RSI: waits for telegrams, keeps the newest, answers it."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, OutputError
from counterflex.runtime import layout as at
from counterflex.wire.decimal_kernel import Bytes
from counterflex.wire.kuka_pose_kernel import read_axes, read_pose, write_axes, write_correction
from counterflex.wire.rsi_config import RsiConfig
from counterflex.wire.rsi_kernel import MISSING, OK
from counterflex.wire.rsi_telegram import LARGEST_DATAGRAM, answer_writer, robot_reader

LOOPBACK: Final = ("127.0.0.1", "localhost", "::1")
_RESTART: Final = 250
"""Cycles by which the counter may jump ahead within one session."""


@dataclass(eq=False)
class Counters:
    """What came, since the link was opened.

    Attributes:
        telegrams: Good ones that were answered or could have been.
        drained: Older ones that were passed over because a newer one was there.
        malformed: In all.
        malformed_in_a_row: Until the last good one.
        foreign: From an address that is not the controller's.
        old: With a counter at or before the last one.
        lost: Cycles without a telegram, by the counter.
        late_at_robot: What the controller itself counts as late (Delay), last value.
    """

    telegrams: int = 0
    drained: int = 0
    malformed: int = 0
    malformed_in_a_row: int = 0
    foreign: int = 0
    old: int = 0
    lost: int = 0
    late_at_robot: int = 0


class RsiLink:
    """One RSI session from the sensor program's side.

    Args:
        config: The controller's ETHERNET configuration.
        host: Address to listen on; loopback unless told otherwise.
        port: None takes the one of the configuration; 0 a free one.
        peers: Addresses whose telegrams are taken; None takes the first that comes, and from then on only that one.
        period_s: Cycle of the controller.

    Attributes:
        address: Where telegrams are expected.
        counters: See :class:`Counters`.
        elapsed: Cycles from the telegram before to the newest one, by its counter; 0 when none came.
        restarted: The newest telegram belongs to another session than the one before.
        enable: Free tag ``Enable`` of the robot program; True where the configuration has none.
        clamped: The controller says that it limits the correction (free tag ``....Stat`` above 1).

    Raises:
        InputError: The configuration lacks what a correction needs.
        OutputError: The port cannot be bound.
    """

    def __init__(
        self,
        config: RsiConfig,
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        peers: tuple[str, ...] | None = None,
        period_s: float = 4e-3,
    ) -> None:
        self.config = config
        self._reader, self._writer = robot_reader(config), answer_writer(config, texts={"EStr": "counterflex"})
        names = self._reader.names
        pose = next((word for word in ("RSol", "RIst") if f"{word}.X" in names), None)
        if pose is None:
            raise InputError(
                "the RSI configuration sends no pose", where=config.where, hint="Add DEF_RSol and DEF_RIst to SEND"
            )
        axes = next((word for word in ("ASPos", "AIPos") if f"{word}.A1" in names), None)
        if axes is None:
            raise InputError(
                "the RSI configuration sends no axis angles", where=config.where, hint="Add DEF_ASPos to SEND"
            )
        self._nominal = self._reader.place(*(f"{pose}.{a}" for a in "XYZABC"))
        self._axes = self._reader.place(*(f"{axes}.A{i}" for i in range(1, 7)))
        self._actual = self._reader.place(*(f"RIst.{a}" for a in "XYZABC")) if "RIst.X" in names else None
        self._delay = self._reader.place("Delay.D")[0] if "Delay.D" in names else -1
        self._enable = self._reader.place("Enable")[0] if "Enable" in names else -1
        self._stat = next((i for i, name in enumerate(names) if name.endswith(".Stat")), -1)
        answers = self._writer.names
        self._pose_out = (
            self._writer.place(*(f"RKorr.{a}" for a in "XYZABC"))
            if "RKorr.X" in answers and "RKorr.C" in answers
            else None
        )
        word = next((w for w in ("AKorr", "AK") if f"{w}.A1" in answers), None)
        self._axes_out = None if word is None else self._writer.place(*(f"{word}.A{i}" for i in range(1, 7)))
        if self._pose_out is None and self._axes_out is None:
            raise InputError(
                "the RSI configuration takes in no correction",
                where=config.where,
                hint="Add RKorr.X to RKorr.C (wired to POSCORR) or AKorr.A1 to AKorr.A6 (AXISCORR) to RECEIVE",
            )
        self._stop = self._place_of("Stop")
        self._feed_hold = self._place_of("FeedHold")
        self._override = self._place_of("Override")
        self._cycle_ms = round(period_s * 1e3)
        self._peers = peers
        self._peer: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        wanted = config.port if port is None else port
        try:
            self._socket.bind((host, wanted))
        except OSError as fault:
            self._socket.close()
            raise OutputError(
                f"the port cannot be opened: {fault.strerror or fault}",
                where=f"{host}:{wanted}",
                hint="Is another sensor program running? One at a time answers a robot",
            ) from fault
        self.address: tuple[str, int] = self._socket.getsockname()
        self._bytes = bytearray(LARGEST_DATAGRAM)
        self._spare: Bytes = np.frombuffer(self._bytes, dtype=np.uint8)
        self.counters = Counters()
        self.elapsed = 0
        self.restarted = False
        self.enable = False
        self.clamped = False
        self._last = -1
        self._newest = -1
        self._held: Float = np.zeros(len(names))
        self._empty = False

    def _place_of(self, name: str) -> int:
        return self._writer.names.index(name) if name in self._writer.names else -1

    @property
    def cartesian(self) -> bool:
        """Whether Cartesian corrections can be sent."""
        return self._pose_out is not None

    @property
    def axis_specific(self) -> bool:
        """Whether axis corrections can be sent."""
        return self._axes_out is not None

    def wait(self, timeout_s: float) -> bool:
        """Wait for a telegram, then take all that are there and keep the newest good one.

        Args:
            timeout_s: Longest wait.

        Returns:
            Whether there is a telegram to be answered. :attr:`elapsed` says how many cycles passed.
        """
        self.elapsed, self.restarted = 0, False
        found = False
        self._socket.settimeout(timeout_s)
        while True:
            try:
                length, peer = self._socket.recvfrom_into(self._bytes)
            except (TimeoutError, BlockingIOError):
                break
            except ConnectionError:
                continue
            self._socket.settimeout(0.0)
            if self._take(length, peer):
                if found:
                    self.counters.drained += 1
                found = True
        if found:
            self._count()
        return found

    def _take(self, length: int, peer: tuple[str, int]) -> bool:
        counters = self.counters
        if self._peer is None:
            if self._peers is not None and peer[0] not in self._peers:
                counters.foreign += 1
                return False
        elif peer != self._peer:
            counters.foreign += 1
            return False
        status = self._reader.read(self._spare, length)
        if status not in (OK, MISSING):
            counters.malformed += 1
            counters.malformed_in_a_row += 1
            return False
        self._peer = peer
        if status == MISSING and self._reader.seen.any():
            counters.malformed += 1
            counters.malformed_in_a_row += 1
            return False
        self._empty = status == MISSING
        counters.malformed_in_a_row = 0
        step = self._reader.counter - self._newest if self._newest >= 0 else self._cycle_ms
        if 0 >= step > -_RESTART * self._cycle_ms:
            counters.old += 1
            return False
        self._newest = self._reader.counter
        self._held[:] = self._reader.values
        return True

    def _count(self) -> None:
        counters = self.counters
        step = self._newest - self._last
        if self._last < 0:
            self.elapsed = 1
        elif step <= 0 or step > _RESTART * self._cycle_ms:
            self.elapsed, self.restarted = 1, True
        else:
            self.elapsed = max(1, round(step / self._cycle_ms))
            counters.lost += self.elapsed - 1
        self._last = self._newest
        counters.telegrams += 1
        if self._delay >= 0:
            counters.late_at_robot = int(self._held[self._delay])
        self.enable = self._enable < 0 or self._held[self._enable] > 0.5
        self.clamped = self._stat >= 0 and self._held[self._stat] > 1.5

    @property
    def counter(self) -> int:
        """IPOC of the newest telegram, ms."""
        return self._newest

    @property
    def empty(self) -> bool:
        """The newest telegram holds nothing but its counter (a KR C2's first): answer it, do not use it."""
        return self._empty

    def fill(self, given: Float) -> None:
        """Write commanded pose and axis angles of the newest telegram into the inputs of the step."""
        read_pose(self._held, self._nominal, given, at.G_NOMINAL)
        read_axes(self._held, self._axes, given, at.G_Q)

    def fill_actual(self, given: Float) -> bool:
        """Write the pose that the controller reports (encoders, nominal geometry) as measured; False without RIst."""
        if self._actual is None:
            return False
        read_pose(self._held, self._actual, given, at.G_ACTUAL)
        return True

    def answer(
        self,
        correction: Float,
        axes: Float | None = None,
        *,
        stop: bool = False,
        feed_hold: bool = False,
        override: float = 1.0,
    ) -> bool:
        """Answer the newest telegram.

        Args:
            correction: (6,) m and rotation vector; ignored where ``axes`` are given.
            axes: (6,) rad, axis corrections instead.
            stop: Tell the controller to stop.
            feed_hold: Ask the robot program to hold the feed, where the configuration has the tag.
            override: Speed of the program, 0..1, where the configuration has the tag.

        Returns:
            Whether an answer was sent: not, where a number cannot be written or nobody has asked yet.
        """
        values = self._writer.values
        values[:] = 0.0
        if axes is not None and self._axes_out is not None:
            write_axes(axes, values, self._axes_out)
        elif self._pose_out is not None:
            write_correction(correction, values, self._pose_out)
        if self._stop >= 0:
            values[self._stop] = float(stop)
        if self._feed_hold >= 0:
            values[self._feed_hold] = float(feed_hold)
        if self._override >= 0:
            values[self._override] = 100.0 * override
        length = self._writer.write(self._newest)
        if length == 0 or self._peer is None:
            return False
        try:
            self._socket.sendto(self._writer.buffer.data[:length], self._peer)
        except (BlockingIOError, ConnectionError):
            return False
        return True

    def close(self) -> None:
        """Free the port."""
        self._socket.close()
