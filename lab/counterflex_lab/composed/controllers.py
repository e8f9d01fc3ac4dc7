"""Controllers of the stories: KUKA by RSI, ABB by EGM path correction or guidance; each with the loop's link to it."""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, MS
from counterflex.geometry import pose
from counterflex.path.path_speed import PoseStream
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.robot.wire import Wire
from counterflex.runtime.settings import Delays
from counterflex.twin.devices.commanded_motion import Report
from counterflex_lab.composed import bench
from counterflex_lab.composed.motors import Motors
from counterflex_lab.composed.story import Active, Story
from counterflex_lab.devices import (
    LARGEST_DATAGRAM,
    LARGEST_MESSAGE,
    MESSAGES,
    EgmContext,
    EgmGuidanceLink,
    EgmPathLink,
    FakeEgm,
    FakeRsi,
    GuidanceSettings,
    Phase,
    RsiContext,
    RsiLink,
    answer_writer,
)

JOB: Final = 7
MCI_STOPPED: Final = 2
ENDED: Final = "ended"
"""Why a movement of EGM ended that the controller itself ended: it goes on to send."""
STRANGE_M: Final = 7.0
"""Distance of the pose in a stranger's telegrams from everything: it must never be seen inside the loop."""
GUIDED: Final = Delays(12.0 * MS, (20.0 * 2.0 * np.pi * 20.0) ** 0.5, 0.5 * (20.0 * 2.0 * np.pi * 20.0) ** 0.5 * 58e-3)
"""Of a guided robot, as identified: dead time, low-pass of 20 Hz and gain of 20 1/s, together 70 ms."""


class Answer(NamedTuple):
    """An answer of the loop.

    Attributes:
        data: As sent.
        cycle: Of the controller when it was sent.
        state: Of the loop that sent it.
    """

    data: bytes
    cycle: int
    state: int


class Controller(Protocol):
    """A controller in a story.

    Attributes:
        accepted: Newest answer of the loop that it took.
        largest: Longest datagram, bytes.
    """

    accepted: Answer | None
    largest: int

    @property
    def device(self) -> FakeRsi | FakeEgm:
        """The simulated controller, in its present session."""

    @property
    def corrects(self) -> bool:
        """Answers of the loop have effect; not behind a movement of EGM that is corrected."""

    @property
    def held(self) -> bool:
        """A feed hold or a stop is asked for, or in effect."""

    @property
    def reported_state(self) -> int:
        """Of the loop, by the answer that is in force."""

    @property
    def streamed(self) -> bool:
        """The loop has begun to stream its path to a guided robot: it does that once."""

    def restart(self, counter: int) -> None:
        """Begin another session, counters from this on: nothing is in force."""

    def link(self, wire: Wire, clock_ns: Callable[[], int]) -> RobotLink:
        """The loop's side."""

    def telegram(self, report: Report, enable: float, base_off_m: Float) -> bytes:
        """The telegram of the next cycle; the program says ``enable``, its BASE or TOOL is off by (3,) m."""

    def take(self, arrived: Sequence[Answer], *, other: bool) -> bool:
        """Take what came in the cycle; returns whether it obeyed another program.

        Args:
            arrived: In the order of arrival.
            other: Another program answers where the loop does not, and sometimes where it does.
        """

    def drive_torque(self, row: int, force: Float) -> Float:
        """(6,) N m of the drives at a row of the program under a force (3,) N on the tool; zero where none is shown."""

    def shows_force(self, w_sensor: Float | None) -> None:
        """The robot itself measures (6,) N, N m in this cycle, or nothing."""

    def correction_m(self, row: int) -> Float:
        """(3,) correction in force, part axes, at a row of the program."""

    def strange(self, telegram: bytes) -> bytes:
        """A telegram as another computer sends it: whole, and of another place."""


class RsiController:
    """KUKA RSI.

    Args:
        story: Of the cell.
        timeout: Late answers at which it stops.
        active: Faults that act.
        rng: Its chance.
    """

    largest = LARGEST_DATAGRAM

    def __init__(self, story: Story, timeout: int, active: Active, rng: np.random.Generator) -> None:
        self._story, self._rng = story, rng
        self._by_axes = story.mode.endswith("axes")
        self._context = RsiContext(timeout=timeout, cycle_s=story.period_s)
        self._config = bench.config(currents=story.currents)
        self._motors: Motors | None = None
        if story.currents:
            self._motors = Motors(story.seed, active, np.random.default_rng([story.seed, 7]))
        self._other = answer_writer(bench.config(), texts={"EStr": "other"})
        self.accepted: Answer | None = None
        self.restart(int(rng.integers(1, 2**32)))

    @property
    def corrects(self) -> bool:
        """As in :class:`Controller`."""
        return True

    @property
    def held(self) -> bool:
        """As in :class:`Controller`."""
        return self.device.feed_hold or bool(self.device.stopped)

    @property
    def reported_state(self) -> int:
        """As in :class:`Controller`."""
        return self.device.reported_state

    @property
    def streamed(self) -> bool:
        """As in :class:`Controller`: it runs its own program."""
        return False

    def restart(self, counter: int) -> None:
        """As in :class:`Controller`."""
        context = replace(self._context, first_counter=counter)
        self.device = FakeRsi(self._config, context, {"Enable": 0.0}, self._motors, job=JOB)
        self.accepted = None

    def link(self, wire: Wire, clock_ns: Callable[[], int]) -> RobotLink:
        """As in :class:`Controller`."""
        del clock_ns
        host, port = wire.address
        return RsiLink(self._config, host=host, port=port, wire=wire, period_s=self._story.period_s)

    def telegram(self, report: Report, enable: float, base_off_m: Float) -> bytes:
        """As in :class:`Controller`."""
        for T in (report.T_part_nominal, report.T_part_actual):
            T[:3, 3] += base_off_m
        self.device.frees["Enable"] = enable
        data = self.device.telegram(report)
        return data if self._motors is None else self._motors.left_out(data)

    def take(self, arrived: Sequence[Answer], *, other: bool) -> bool:
        """As in :class:`Controller`."""
        mark = f"<IPOC>{self.device.counter}</IPOC>".encode("ascii")
        fitting = [one for one in arrived if mark in one.data]
        if other and (not fitting or self._rng.random() < 0.3):
            self.device.answer(self._others_answer())
            return True
        taken = fitting[-1] if fitting else arrived[-1] if arrived else None
        self.device.answer(None if taken is None else taken.data)
        self.accepted = self.accepted if self.device.refused else taken
        return False

    def drive_torque(self, row: int, force: Float) -> Float:
        """As in :class:`Controller`."""
        return _NO_TORQUE if self._motors is None else self._motors.torque(row, force)

    def shows_force(self, w_sensor: Float | None) -> None:
        """As in :class:`Controller`; it has no such sensor."""

    def _others_answer(self) -> bytes:
        """An answer of another program: what is in force already."""
        writer = self._other
        writer.values[:] = 0.0
        places = writer.place(*(f"RKorr.{a}" for a in "XYZ"))
        writer.values[places] = self.device.correction[:3] / MM
        writer.values[writer.place("Override")] = 100.0
        return writer.telegram(self.device.counter)

    def correction_m(self, row: int) -> Float:
        """As in :class:`Controller`."""
        out: Float = self.device.correction[:3]
        return bench.jacobian()[row] @ self.device.axes if self._by_axes else out

    def strange(self, telegram: bytes) -> bytes:
        """As in :class:`Controller`."""
        begin = telegram.find(b'<RSol X="')
        if begin < 0:
            return telegram
        begin += len(b'<RSol X="')
        end = telegram.index(b'"', begin)
        return telegram[:begin] + f"{STRANGE_M / MM:.4f}".encode("ascii") + telegram[end:]


class EgmController:
    """ABB EGM. The newest message counts, whichever telegram it answers: nothing in it says so.

    Args:
        story: Of the cell.
        timeout_s: CommTimeout.
        active: Faults that act.
        rng: Its chance.
    """

    largest = LARGEST_MESSAGE

    def __init__(self, story: Story, timeout_s: float, active: Active, rng: np.random.Generator) -> None:
        self._active, self._rng = active, rng
        self._guides = story.link == "egm-pose"
        self._frame, self._robotware = story.frame, 6 + story.seed % 2
        self._begins_other = any(fault.kind == "frame-other" for fault in story.faults)
        self._context = EgmContext(
            mode="pose" if self._guides else "path",
            cycle_s=story.period_s,
            timeout_s=timeout_s,
            robotware=self._robotware,
            gain_per_s=float(rng.uniform(17.0, 20.0)),
        )
        self._period_s = story.period_s
        self.accepted: Answer | None = None
        self._link: EgmGuidanceLink | None = None
        self._seen: Float | None = None
        self._beside: Float = np.zeros(3)
        self.restart(int(rng.integers(1, 2**32)))

    @property
    def corrects(self) -> bool:
        """As in :class:`Controller`."""
        return self.device.enabled

    @property
    def held(self) -> bool:
        """As in :class:`Controller`; a path that is streamed more slowly is about to stand."""
        return bool(self.device.stopped) or (self._link is not None and self._link.stream.rate < 1.0)

    @property
    def reported_state(self) -> int:
        """As in :class:`Controller`; no message of EGM says it."""
        return -1 if self.accepted is None else self.accepted.state

    @property
    def streamed(self) -> bool:
        """As in :class:`Controller`."""
        return self._link is not None and self._link.phase != Phase.WAITING

    def restart(self, counter: int) -> None:
        """As in :class:`Controller`; a session of EGM counts its messages from 0 on, ``counter`` is its clock, ms."""
        other, self._begins_other = self._begins_other or "frame-other" in self._active.now, False
        self._T_part_frame = _frame(self._frame, other=other)
        self.device = FakeEgm(replace(self._context, first_ms=counter), self._T_part_frame)
        self.accepted = None

    def link(self, wire: Wire, clock_ns: Callable[[], int]) -> RobotLink:
        """As in :class:`Controller`."""
        where: dict[str, Any] = {"host": wire.address[0], "port": wire.address[1], "wire": wire, "clock_ns": clock_ns}
        where["T_part_frame"] = _frame(self._frame)
        if self._guides:
            guidance = GuidanceSettings(lag_s=GUIDED.correction_s)
            self._link = EgmGuidanceLink(copy.copy(stream(self._period_s)), guidance, **where)
            return self._link
        return EgmPathLink(watch_only=False, period_s=self._period_s, **where)

    def telegram(self, report: Report, enable: float, base_off_m: Float) -> bytes:
        """As in :class:`Controller`; its path frame is that of the path, wherever the poses are said to lie."""
        now, size = self._active.now, self._active.size
        flickers = "enable-flickers" in now and enable == 0.0  # in the message; the movement goes on
        self.device.enabled = self.device.enabled if flickers else enable > 0.0
        data = self.device.telegram(report)
        if _FALSIFYING.isdisjoint(now):
            return data
        message = MESSAGES["EgmRobot"]()
        message.ParseFromString(data)
        self._shift(message, base_off_m)
        if flickers:
            message.mciState.state = MCI_STOPPED
        if "sequence-stuck" in now and self._rng.random() < size("sequence-stuck"):
            message.header.seqno = max(0, message.header.seqno - 1)
        if "clock-missing" in now:
            message.header.ClearField("tm")
        if message.HasField("measuredForce"):
            self._falsify_force(message)
        if "motion-limited" in now:
            message.utilizationRate = 100.0 * size("motion-limited")
        if "message-short" in now and self._rng.random() < size("message-short"):
            part, field = (
                (message.header, "seqno"),
                (message.feedBack, "joints"),
                (message.feedBack, "cartesian"),
                (message.planned, "cartesian"),
                (message, "mciState"),
            )[int(self._rng.integers(0, 5))]
            part.ClearField(field)
        out: bytes = message.SerializeToString()
        return out

    def _shift(self, message: Any, base_off_m: Float) -> None:
        off = base_off_m if self._T_part_frame is None else self._T_part_frame[:3, :3].T @ base_off_m
        for part in (message.feedBack, message.planned):
            at = part.cartesian.pos
            at.x, at.y, at.z = (np.array([at.x, at.y, at.z]) + off / MM).tolist()

    def _falsify_force(self, message: Any) -> None:
        """Force control that is not active, or another number of forces."""
        now, seven = self._active.now, self._robotware == 7
        if "force-nan" not in now and "force-short" not in now:
            return
        inside = MESSAGES["EgmForceSeven" if seven else "EgmForceSix"]()
        inside.ParseFromString(message.measuredForce)
        if "force-nan" in now and seven:
            inside.fcActive = False
        elif "force-nan" in now:
            message.ClearField("measuredForce")
            return
        if "force-short" in now and self._rng.random() < self._active.size("force-short"):
            del inside.force[5:]
        message.measuredForce = inside.SerializeToString()

    def take(self, arrived: Sequence[Answer], *, other: bool) -> bool:
        """As in :class:`Controller`; no story has another program that answers it."""
        del other
        self.device.answer(arrived[-1].data if arrived else None)
        if arrived and not self.device.refused:
            self.accepted = arrived[-1]
        return False

    def drive_torque(self, row: int, force: Float) -> Float:
        """As in :class:`Controller`."""
        del row, force
        return _NO_TORQUE

    def shows_force(self, w_sensor: Float | None) -> None:
        """As in :class:`Controller`."""
        self.device.force = w_sensor

    def correction_m(self, row: int) -> Float:
        """As in :class:`Controller`; of guidance what of the newest pose lies beside the path."""
        if not self._guides:
            out: Float = self.device.pose_correction()[:3]
            return out
        T = self.device.reference
        if T is not self._seen:
            self._seen, self._beside = T, np.zeros(3) if T is None else bench.beside(T[:3, 3], row)[1]
        return self._beside

    def strange(self, telegram: bytes) -> bytes:
        """As in :class:`Controller`."""
        message = MESSAGES["EgmRobot"]()
        message.ParseFromString(telegram)
        for part in (message.feedBack, message.planned):
            part.cartesian.pos.x = STRANGE_M / MM
        out: bytes = message.SerializeToString()
        return out


_NO_TORQUE: Final = np.zeros(6)


@functools.cache
def stream(period_s: float) -> PoseStream:
    """The program as it is streamed to a guided robot, at its beginning."""
    own = bench.program()
    p = own.p[: own.end + 1]
    n = len(p)
    ones, wholes = np.ones(n), np.zeros(n, dtype=np.int64)
    path = ToolPath(
        p,
        np.tile(-own.R[:, 2], (n, 1)),
        wholes + FEED,
        bench.FEED_M_S * ones,
        0.0 * ones,
        np.arange(n, dtype=np.float64) * (bench.SPACING_M / bench.FEED_M_S),
        wholes,
        wholes,
    )
    return PoseStream(pose.make(np.tile(own.R, (n, 1, 1)), p), path, period_s=period_s)


def _frame(name: str, *, other: bool = False) -> Float | None:
    """Frame (4, 4) of the messages in the part frame; None: they are in the part frame."""
    if (name == "part") != other:
        return None
    T_part_base: Float = pose.inverse(bench.program().T_base_part)
    return T_part_base


_FALSIFYING: Final = frozenset(
    (
        "base-off",
        "enable-flickers",
        "sequence-stuck",
        "clock-missing",
        "motion-limited",
        "message-short",
        "force-nan",
        "force-short",
    )
)


def controller_of(story: Story, active: Active, rng: np.random.Generator) -> Controller:
    """The controller of a story.

    Args:
        story: Of the cell.
        active: Faults that act.
        rng: Its chance.
    """
    timeout = int(rng.choice([10, 30, 1000]))
    if story.link == "rsi":
        return RsiController(story, timeout, active, rng)
    return EgmController(story, 0.1 if timeout > 10 else 2.5 * story.period_s, active, rng)
