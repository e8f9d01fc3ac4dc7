"""The loop's side: a link to the robot as RSI and EGM are."""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.app.robot_axes import axes_in
from counterflex.app.run.robot_links import LinkOrder, RobotLinkKind
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.geometry import pose
from counterflex.protocols.robot.port import RobotPort, Verdict
from counterflex.protocols.robot.session_counter import SessionCounter
from counterflex.runtime.plausibility.axis_check import ABSENT, EXACT
from counterflex.runtime.settings import Output
from counterflex.runtime.state.supervisor import State

from . import telegram


class MelfaLink:
    """One session; see :class:`counterflex.protocols.robot.link.RobotLink`.

    Raises:
        InputError: The loop wants what this link has no word for.
        OutputError: The port cannot be bound.
    """

    elapsed, restarted, enable = 0, False, False
    clamped, holds_feed, empty, job = False, False, False, 0
    commanded_is, measured_is = EXACT, ABSENT

    def __init__(self, order: LinkOrder) -> None:
        if order.online.output == Output.AXES or order.overriding or order.currents:
            raise InputError(
                "the link melfa corrects poses, and nothing else",
                where=str(order.cell.path),
                hint='Set output = "cartesian", and leave out [override] and run.currents',
            )
        self._axes = axes_in(order.cell, "melfa")[0]
        port = int(order.values["port"]) if order.port is None else order.port
        self._port = RobotPort(order.host, port, telegram.LARGEST, order.peer)
        self._line = SessionCounter(round(order.online.period_s * 1e3))
        self.counters, self.address = self._port.counters, self._port.address
        self._numbers: Float = np.zeros(13)

    @property
    def counter(self) -> int:
        """Of the newest telegram, ms."""
        return self._line.newest

    def wait(self, timeout_s: float) -> bool:
        """Wait for a telegram, then keep the newest good one."""
        self.elapsed, self.restarted = 0, False
        received = self._port.wait(timeout_s, self._read)
        if received:
            self.elapsed, self.restarted = self._line.advance()
            self.counters.lost += self.elapsed - 1
            self.counters.telegrams += 1
            self.enable = bool(self._numbers[0] > 0.5)
        return received

    def _read(self, length: int) -> Verdict:
        found = telegram.read("R", self._port.data[:length].tobytes(), 13)
        if found is None:
            return Verdict.MALFORMED
        verdict = self._line.judge(found[0])
        if verdict == Verdict.NEW:
            self._numbers[:] = found[1]
        return verdict

    def fill(self, nominal: Float, q: Float) -> None:
        """Write commanded pose and angles."""
        T = pose.from_xyz_zyx(self._numbers[1:4] * MM, self._numbers[4:7] * DEG)
        nominal[:9], nominal[9:] = T[:3, :3].reshape(-1), T[:3, 3]
        q[:] = self._axes.model(self._numbers[7:] * DEG)

    def fill_actual(self, _: Float) -> bool:
        """False: it is not sent."""
        return False

    fill_reported = fill_currents = fill_actual

    def answer(
        self,
        correction: Float,
        _: Float | None = None,
        *,
        stop: bool = False,
        feed_hold: bool = False,  # noqa: ARG002
        override: float = 1.0,  # noqa: ARG002
        state: State = State.IDLE,  # noqa: ARG002
    ) -> bool:
        """Send the correction."""
        numbers = [*(correction[:3] / MM), *(correction[3:] / DEG), float(stop)]
        return bool(np.all(np.isfinite(numbers))) and self._port.send(telegram.line("C", self.counter, numbers))

    def forget(self) -> None:
        """Another session may come from another port of the controller."""
        self._port.forget()

    def close(self) -> None:
        """Free the port."""
        self._port.close()


LINK: Final = RobotLinkKind(
    title="Mitsubishi, lines of text over UDP",
    open=MelfaLink,
    values={"port": 10_000, "timeout_cycles": 100},
    simulated="counterflex_example.melfa.simulated:controller",
)
