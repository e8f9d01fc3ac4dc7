"""The sensor program's side of KUKA RSI: waits for telegrams, keeps the newest, answers it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from counterflex.core.array_table import ArrayTable
from counterflex.core.arrays import Float, Int
from counterflex.core.entry_calls import address_of
from counterflex.core.errors import InputError
from counterflex.core.records import attributes, records
from counterflex.integrations.kuka.link.answer_kernel import ARRAYS, answer
from counterflex.integrations.kuka.link.config import RsiConfig
from counterflex.integrations.kuka.link.cycle_kernel import ARRAYS as READ_ARRAYS, answer_at, read_at, read_words
from counterflex.integrations.kuka.link.kernel import MISSING, OK
from counterflex.integrations.kuka.link.pose_kernel import read_pose, read_stand
from counterflex.integrations.kuka.link.telegram import LARGEST_DATAGRAM, answer_writer, robot_reader
from counterflex.protocols.robot.compiled_link import TELEGRAM, CompiledLink
from counterflex.protocols.robot.port import Counters, RobotPort, Verdict
from counterflex.protocols.robot.session_counter import SessionCounter
from counterflex.protocols.robot.wire import Wire
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.runtime.plausibility.axis_check import ABOUT, ABSENT, EXACT
from counterflex.runtime.state.supervisor import State

_AXES = tuple(f"A{i}" for i in range(1, 7))
_CURRENTS = tuple(f"MACur.{axis}" for axis in _AXES)
_COUNTER = re.compile(rb"<IPOC>\s*(\d{1,15})\s*</IPOC>")
_MALFORMED, _NEW = Verdict.MALFORMED, Verdict.NEW


def _first_of(words: tuple[str, ...], part: str, names: Sequence[str]) -> str:
    """The first of several elements that a configuration has; empty where it has none."""
    return next((word for word in words if f"{word}.{part}" in names), "")


def _tags(word: str, parts: Sequence[str]) -> list[str]:
    return [f"{word}.{part}" for part in parts]


def _place_in(names: Sequence[str], name: str) -> int:
    """Place of a value; -1 where there is none."""
    return names.index(name) if name in names else -1


def _ending_in(names: Sequence[str], ending: str) -> int:
    """Place of the first value whose name ends so; -1 where there is none."""
    return next((place for place, name in enumerate(names) if name.endswith(ending)), -1)


def _or_nowhere(places: Int | None) -> Int:
    return np.zeros(0, dtype=np.int64) if places is None else places


class RsiLink:
    """One RSI session from the sensor program's side.

    Args:
        config: The controller's ETHERNET configuration.
        host: Address to listen on; loopback unless told otherwise.
        port: None takes the one of the configuration; 0 a free one.
        peer: Address and port of the controller, see :class:`RobotPort`.
        period_s: Cycle of the controller.
        axes: How the controller counts the axes of its telegrams.
        wire: What carries the telegrams; None opens the port.

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
        peer: tuple[str, int] | None = None,
        period_s: float = 4e-3,
        axes: ControllerAxes = AS_MODEL,
        wire: Wire | None = None,
    ) -> None:
        self._counted = None if axes.matrix is None else axes
        self.config = config
        self._reader, self._writer = robot_reader(config), answer_writer(config, texts={"EStr": "counterflex"})
        names = self._reader.names
        pose, angles = _first_of(("RSol", "RIst"), "X", names), _first_of(("ASPos", "AIPos"), "A1", names)
        for word, what, lacking in ((pose, "pose", "DEF_RSol and DEF_RIst"), (angles, "axis angles", "DEF_ASPos")):
            if not word:
                hint = f"Add {lacking} to SEND"
                raise InputError(f"the RSI configuration sends no {what}", where=config.where, hint=hint)
        self._nominal = self._reader.place(*_tags(pose, "XYZABC"))
        self._axes = self._reader.place(*_tags(angles, _AXES))
        self._actual = self._reader.place(*_tags("RIst", "XYZABC")) if "RIst.X" in names else None
        set_angles = angles == "ASPos"
        # Whether set angles come with a set pose or measured with measured ones (EXACT), or not (ABOUT)
        self.commanded_is = EXACT if set_angles == (pose == "RSol") else ABOUT
        # Likewise the measured pose; ABSENT without RIst
        self.measured_is = ABSENT if self._actual is None else ABOUT if set_angles else EXACT
        self._currents = self._reader.place(*_CURRENTS) if set(_CURRENTS) <= set(names) else None
        answers = self._writer.names
        by_pose, axes_word = {"RKorr.X", "RKorr.C"} <= set(answers), _first_of(("AKorr", "AK"), "A1", answers)
        self._pose_out = self._writer.place(*_tags("RKorr", "XYZABC")) if by_pose else None
        self._axes_out = self._writer.place(*_tags(axes_word, _AXES)) if axes_word else None
        if self._pose_out is None and self._axes_out is None:
            hint = "Add RKorr.X to RKorr.C (wired to POSCORR) or AKorr.A1 to AKorr.A6 (AXISCORR) to RECEIVE"
            raise InputError("the RSI configuration takes in no correction", where=config.where, hint=hint)
        self._override = self._place_of("Override")
        self._line = SessionCounter(round(period_s * 1e3))
        self._port = RobotPort(host, config.port if port is None else port, LARGEST_DATAGRAM, peer, wire)
        self.counters: Counters = self._port.counters  # See :class:`Counters`
        self.elapsed = 0  # Cycles from the telegram before to the newest one, by its counter; 0 when none came
        self.restarted = False  # The newest telegram belongs to another session than the one before
        self.enable = False  # Free tag ``Enable`` of the robot program; True where the configuration has none
        self.clamped = False  # The controller says that it limits the correction (free tag ``....Stat`` above 1)
        self.job = 0  # Number of the job that the program says it is of: ``Enable`` above 1; 0: it says none
        self._numbers: Float = np.zeros(len(names))
        self._words = self._read_table(names)
        self.telegram = records(TELEGRAM)  # What the newest one says beside poses and angles
        self._message: Any = attributes(self.telegram)
        self._message.late = self._message.newest = -1
        self._message.cycle_ms = round(period_s * 1e3)
        self.holds_feed = self._place_of("FeedHold") >= 0  # The configuration has the tag ``FeedHold``
        places = [self._place_of(name) for name in ("Stop", "FeedHold", "Override", "State")]
        pieces, parts = self._writer.fixed
        self._table = ArrayTable(
            ARRAYS,
            values=self._writer.values,
            pose=_or_nowhere(self._pose_out),
            axes=_or_nowhere(self._axes_out),
            free=np.array(places, dtype=np.int64),
            buffer=self._writer.buffer,
            pieces=pieces,
            parts=parts,
            name=self._port.name,
        )
        self._empty = False
        self._again: tuple[bool, bool, float, State] | None = None
        self._last_correction: Float = np.zeros(6)
        self._last_as_axes = False
        self._repeated_counter = -1

    def _read_table(self, names: Sequence[str]) -> ArrayTable:
        words = [_place_in(names, "Delay.D"), _place_in(names, "Enable"), _ending_in(names, ".Stat")]
        return ArrayTable(
            READ_ARRAYS,
            **self._reader.arrays(),
            numbers=self._numbers,
            words=np.array(words, dtype=np.int64),
            pose=self._nominal,
            axes=self._axes,
            actual=_or_nowhere(self._actual),
        )

    def _place_of(self, name: str) -> int:
        return _place_in(self._writer.names, name)

    @property
    def cartesian(self) -> bool:
        """True where Cartesian corrections can be sent."""
        return self._pose_out is not None

    @property
    def axis_specific(self) -> bool:
        """True where axis corrections can be sent."""
        return self._axes_out is not None

    @property
    def has_currents(self) -> bool:
        """True where motor currents come."""
        return self._currents is not None

    @property
    def overriding(self) -> bool:
        """True where the speed of the program can be changed."""
        return self._override >= 0

    def wait(self, timeout_s: float, waiting: int = 0) -> bool:
        """Wait for a telegram; see :class:`counterflex.protocols.robot.link.RobotLink`.

        Args:
            waiting: See :meth:`RobotPort.wait`.
        """
        self.elapsed, self.restarted = 0, False
        received = self._port.wait(timeout_s, self._read, waiting)
        if received:
            self._count()
        return received

    def compiled(self) -> CompiledLink | None:
        """Reading and answering for the one call of a cycle; None where Python counts the axes otherwise."""
        if self._counted is not None:
            return None
        return CompiledLink(
            telegram=self.telegram,
            port=self._port,
            read=address_of(read_at),
            read_table=self._words,
            answer=address_of(answer_at),
            answer_table=self._table,
            reports=self._actual is not None,
            axes=self._axes_out is not None,
        )

    def take(self) -> None:
        """Take a telegram that was read in the one call of a cycle."""
        self._port.counters.malformed_in_a_row, self._empty = 0, False
        self._line.judge(self._message.counter)
        self._count()

    def _read(self, length: int) -> Verdict:
        status = self._reader.read(self._port.data, length)
        if status not in (OK, MISSING) or (status == MISSING and self._reader.seen.any()):
            self._repeat_answer(length)
            return _MALFORMED
        verdict = self._line.judge(self._reader.counter)
        if verdict is _NEW:
            self._empty = status == MISSING
            self._numbers[:] = self._reader.values
        return verdict

    def _repeat_answer(self, length: int) -> None:
        """Answer a telegram whose numbers cannot be read, but whose counter can: with what :meth:`repeat` was told."""
        # It is no telegram for the loop. But a robot whose telegrams are unreadable without end must be told to stop.
        if self._again is None:
            return
        match = _COUNTER.search(self._port.data[:length].tobytes())
        counter = int(match.group(1)) if match is not None else -1
        if not self._line.follows(counter) or counter == self._repeated_counter:
            return
        self._repeated_counter = counter
        self.counters.repeated += self._send(counter, *self._again)

    def _send(self, counter: int, stop: bool, feed_hold: bool, override: float, state: State) -> bool:
        """Send the last correction, by the kernel or where that has no socket by the port; returns whether it was."""
        fd, correction, as_axes = self._port.target, self._last_correction, self._last_as_axes
        length = answer(self._table.rows, fd, counter, correction, as_axes, stop, feed_hold, override, int(state))
        return length > 0 and (fd >= 0 or self._port.send(self._writer.buffer.data[:length]))

    def repeat(self, *, stop: bool, feed_hold: bool, override: float, state: State, silent: bool) -> None:
        """Set the words beside the last correction for telegrams that can only be answered, not read.

        Args:
            stop: Tell the controller to stop.
            feed_hold: Ask for the feed to be held.
            override: Speed of the program, 0..1.
            state: What the loop is doing.
            silent: Say nothing.
        """
        self._again = None if silent else (stop, feed_hold, override, state)

    def _count(self) -> None:
        counters = self.counters
        self.elapsed, self.restarted = self._line.advance()
        counters.lost += self.elapsed - 1
        counters.telegrams += 1
        message = self._message
        read_words(self._words.rows, self.telegram)
        counters.late_at_robot, message.newest = message.late, self._line.newest
        self.enable, self.job, self.clamped = message.enable == 1, message.job, message.clamped == 1

    @property
    def address(self) -> tuple[str, int]:
        """Address at which telegrams are expected."""
        return self._port.address

    @property
    def counter(self) -> int:
        """IPOC of the newest telegram, ms."""
        return self._line.newest

    @property
    def empty(self) -> bool:
        """The newest telegram holds nothing but its counter (a KR C2's first): answer it, do not use it."""
        return self._empty

    def fill(self, nominal: Float, q: Float) -> None:
        """Write commanded pose and axis angles of the newest telegram: (12,) rotation by rows, position; (6,) rad."""
        read_stand(self._numbers, self._nominal, self._axes, nominal, q)
        if self._counted is not None:
            q[:] = self._counted.model(q)

    def fill_actual(self, out: Float) -> bool:
        """Write the pose that the controller reports (encoders, nominal geometry) as measured; False without RIst."""
        if self._actual is None:
            return False
        read_pose(self._numbers, self._actual, out, 0)
        return True

    def fill_reported(self, out: Float) -> bool:
        """Write the pose that the controller itself reports (RIst: encoders, nominal geometry); False without one."""
        if self._actual is None:
            return False
        read_pose(self._numbers, self._actual, out, 0)
        return True

    def fill_currents(self, current: Float) -> bool:
        """Write the motor currents (6,) MACur as they are sent: A, or % of the largest; False without them."""
        if self._currents is None:
            return False
        np.take(self._numbers, self._currents, out=current)
        return True

    def answer(
        self,
        correction: Float,
        axes: Float | None = None,
        *,
        stop: bool = False,
        feed_hold: bool = False,
        override: float = 1.0,
        state: State = State.IDLE,
    ) -> bool:
        """Answer the newest telegram; see :class:`counterflex.protocols.robot.link.RobotLink`.

        What the configuration has no tag for (feed hold, override, state) is left out.

        Returns:
            Whether an answer was sent: not, where a number cannot be written or nobody has asked yet.
        """
        self.answered(correction, axes, stop=stop, feed_hold=feed_hold, override=override, state=state)
        return self._send(self._line.newest, stop, feed_hold, override, state)

    def answered(
        self, correction: Float, axes: Float | None, *, stop: bool, feed_hold: bool, override: float, state: State
    ) -> None:
        """Keep an answer, which is also that to a telegram that cannot be read; see :meth:`answer`."""
        as_axes = axes is not None and self._axes_out is not None
        sent: Float = axes if as_axes and axes is not None else correction
        if as_axes and self._counted is not None:
            sent = self._counted.shown_change(sent)
        self._last_correction[:], self._last_as_axes = sent, as_axes
        self._again = stop, feed_hold, override, state

    def poll(self, period_s: float, most_s: float) -> None:
        """Poll when a telegram is due, see :meth:`RobotPort.poll`."""
        self._port.poll(period_s, most_s)

    def forget(self) -> None:
        """Another session may come from another port of the controller."""
        self._port.forget()

    def close(self) -> None:
        """Free the port."""
        self._port.close()
