"""The robot program and the operator of a cell: arm, start, look, acknowledge, start the controller again."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.protocols.processes.control_array import Life, Request, Shown
from counterflex.runtime.state.states import State
from counterflex_lab.composed.cell import JOB

_LOOKS: Final = 25
"""Cycles from one look of the operator to the next."""
_ARMED_CYCLES: Final = 50
_PATIENCE: Final = 600
"""Cycles until the operator starts the controller again that does not go on, or a loop that does not get ready."""
_OTHER_JOB: Final = 99


class People:
    """Program and operator.

    Args:
        world: The :class:`counterflex_lab.composed.world.World` that they act on; it holds them.
        rng: Their chance.

    Attributes:
        running: The program runs, and wants the correction.
        waits: Cycles since something went on.
        off_s: The controller is off until then, or 0.
        programs: Ended at the end of their path.
        wanted_at: Cycle in which the program began to want the correction.
    """

    def __init__(self, world: Any, rng: np.random.Generator) -> None:
        self._world, self._rng = world, rng
        self.running = False
        self.waits = self._armed = self.wanted_at = 0
        self.off_s = 0.0
        self.programs = 0
        self._reset_due = False

    def enable(self, now: dict[str, Any], rng: np.random.Generator) -> float:
        """What the program says by its tag Enable."""
        on = self.running and not self._world.robot.at_end
        if on and "enable-flickers" in now and rng.random() < self._world.active.size("enable-flickers"):
            on = False
        job = _OTHER_JOB if "other-job" in now else JOB
        return float(job) if on else 0.0

    def asks(self, what: str) -> None:
        """Ask something of the loop, as :func:`counterflex.app.run.operator_requests.ask` does."""
        world = self._world
        if world.session is None:
            return
        words = world.control
        if what == "stop":
            words[Request.STOP] = 1
        elif what == "reset":
            words[Request.RESET] = 1
        elif what == "end":
            words[Request.END] = 1
        elif what == "arm" and words[Life.MAY_ARM] and words[Shown.STATE] == State.READY:
            words[Request.STOP] = 0
            words[Request.ARM] = 1

    def recover(self, off_s: float | None = None) -> None:
        """Switch the controller's session off; it begins again after a while, at the beginning of its program."""
        world = self._world
        if self.off_s:
            return
        self.off_s = world.now_s + (float(self._rng.uniform(0.3, 2.5)) if off_s is None else off_s)
        world.sends = False
        self.running = False
        world.robot.runs = False
        self._reset_due = True

    def act(self) -> None:
        """One cycle."""
        world = self._world
        robot = world.robot
        self.waits += 1
        if self.off_s:
            if world.now_s < self.off_s:
                return
            self.off_s, self.waits, self._armed = 0.0, 0, 0
            port = int(self._rng.integers(20000, 60000)) if self._rng.random() < 0.3 else None
            robot.begin()
            world.restart(int(self._rng.integers(1, 2**32)), port=port)
        if self.running:
            self._watch()
        else:
            self._prepare()

    def _watch(self) -> None:
        world = self._world
        robot, state = world.robot, world.state
        if robot.at_end and robot.place >= world.robot.last:
            self.running = robot.runs = False
            self.programs += 1
            self.waits = self._armed = 0
            robot.begin()
        elif state in (State.ACTIVE, State.HOLD) and not world.controller.stopped:
            self.waits = 0
        elif self.waits > _PATIENCE:
            self.recover()

    def _prepare(self) -> None:
        world = self._world
        state = world.state
        if self.waits > _PATIENCE:
            self.waits = 0
            self.recover()
            return
        if state == State.ARMED and not world.controller.stopped:
            self._armed += 1
            if self._armed >= _ARMED_CYCLES:
                self.running = world.robot.runs = True
                self.waits, self.wanted_at = 0, world.cycles
            return
        self._armed = 0
        if world.session is None or self.waits % _LOOKS:
            return
        words = world.control
        if self._reset_due or words[Shown.FEED_HOLD] or state == State.FAULT:
            self._reset_due = False
            self.asks("reset")
        elif state == State.READY:
            self.asks("arm")
        elif words[Request.ARM]:
            words[Request.ARM] = 0
