"""What an operator may ask of a run while it goes on: its state, a stop, a reset, to be armed. And what came of it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.links.control_array import Request
from counterflex.links.operator_port import Asked, OperatorPort, ask
from counterflex.runtime.layout import O_CAUSE, O_FEED_HOLD, O_HARD, O_SOFT, O_STATE
from counterflex.runtime.record_ring import OUTCOME, RESULTS
from counterflex.runtime.supervisor import Cause, State

ACTIONS: Final = ("status", "stop", "reset", "arm")
_ANSWERED_S: Final = 0.3
"""When it is looked what came of a request."""


class OperatorRequests:
    """The run's side: hands requests to the loop and answers what came of them.

    Args:
        port: Where they come.
        control: Shared with the loop.
        may_arm: The run was started to correct; one that only watches is not armed from outside.
    """

    def __init__(self, port: OperatorPort, control: Any, *, may_arm: bool) -> None:
        self._port, self._control, self._may_arm = port, control, may_arm
        self._open: list[tuple[Asked, State]] = []
        self._last: Float | None = None

    def serve(self, row: Float | None) -> bool:
        """Take requests and answer those whose time has come.

        Args:
            row: (WIDTH,) newest record, or None where there is no new one.

        Returns:
            Whether the loop is to be armed.
        """
        self._last = self._last if row is None else row
        arm = False
        for asked in self._port.poll():
            state = self._state()
            self._open.append((asked, state))
            if asked.action == "stop":
                self._control[Request.STOP] = 1
            elif asked.action == "reset":
                self._control[Request.RESET] = 1
            elif asked.action == "arm" and self._may_arm and state == State.READY:
                self._control[Request.STOP] = 0
                arm = True
        now = time.monotonic()
        due = [entry for entry in self._open if entry[0].action == "status" or now - entry[0].time_s > _ANSWERED_S]
        for asked, before in due:
            self._open.remove((asked, before))
            self._port.answer(asked, self._answer(asked.action, before))
        return arm

    def _state(self) -> State:
        return State.IDLE if self._last is None else State(int(self._last[OUTCOME + O_STATE]))

    def _answer(self, action: str, before: State) -> dict[str, Any]:
        last = self._last
        state = self._state()
        cause, hard, held, correction = Cause.NONE, Cause.NONE, False, 0.0
        if last is not None:
            cause = Cause(int(last[OUTCOME + O_CAUSE]) or int(last[OUTCOME + O_SOFT]))
            hard = Cause(int(last[OUTCOME + O_HARD]))
            held = bool(last[OUTCOME + O_FEED_HOLD])
            correction = float(np.linalg.norm(last[RESULTS : RESULTS + 3]))
        refused = ""
        if action not in ACTIONS:
            refused = "no such request"
        elif action == "stop" and state in (State.ACTIVE, State.HOLD):
            refused = "not stopped yet"
        elif action == "reset" and state == State.FAULT:
            refused = (
                "a correction is in force at the robot: end the robot program first"
                if correction > 0.0
                else f"its cause is still there: {(hard or cause).name.lower().replace('_', ' ')}"
            )
        elif action == "arm" and not self._may_arm:
            refused = "the run only watches: start it with --arm"
        elif action == "arm" and state < State.ARMED:
            refused = (
                f"not ready, but {before.name.lower()}"
                if before != State.READY
                else "a check fails, or the robot program has switched the correction on already"
            )
        return {
            "done": not refused,
            "refused": refused,
            "state": state.name.lower(),
            "cause": cause.name.lower(),
            "feed_hold": held,
            "correction_mm": round(correction / MM, 4),
            "robot_heard": last is not None,
        }


def request(folder: str | Path, action: str) -> dict[str, Any]:
    """Ask something of the run whose log lies in a folder.

    Args:
        folder: Of the run.
        action: One of :data:`ACTIONS`.

    Returns:
        ``done``, or why not (``refused``); ``state``, ``cause``, ``feed_hold``, ``correction_mm``, ``robot_heard``.

    Raises:
        InputError: No such request.
        FileFormatError: No run goes on there.
        OutputError: It does not answer.
    """
    if action not in ACTIONS:
        raise InputError("no such request", value=action, limit=", ".join(ACTIONS))
    return ask(Path(folder), action)
