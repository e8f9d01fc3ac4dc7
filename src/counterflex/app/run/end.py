"""End of a run, in one word, and the exit status that says it to a script."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.protocols.session.tracker_off import offset_message
from counterflex.runtime.record_ring import column
from counterflex.runtime.state.supervisor import Cause, State

AS_REQUESTED: Final = "as asked"
"""How a loop ended that ended by itself."""


class End(IntEnum):
    """Ends of a run; the number is the exit status of the command."""

    PLANNED = 0
    """The robot program has switched the correction off itself, or the loop was to watch only."""
    DIED = 1
    """The loop's process died."""
    FAULT = 3
    """A fault, or a hold that lasted, ended the correction; or the robot fell silent while it acted."""
    NEVER_ARMED = 4
    """It was to correct and never did: a check failed, no telegram came, or the program never switched it on."""
    LOG_LOST = 5
    """Records are missing in the log, or its recorder died."""
    STOPPED = 6
    """The operator, a signal or the end of the time given ended the correction before the program did."""


class RunEnd:
    """Follows the states of a run to what ended its correction last."""

    def __init__(self) -> None:
        self._state, self._cause = int(State.IDLE), int(Cause.NONE)
        self._how, self._why = "never", int(Cause.NONE)
        self._began = int(Cause.NONE)

    def add(self, rows: Float) -> None:
        """Look at further records.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`.
        """
        states, causes = rows[:, column("out_state")].astype(int), rows[:, column("out_cause")].astype(int)
        changed = np.flatnonzero(np.diff(states, prepend=self._state))
        for k in changed:
            before, state = self._state, int(states[k])
            if state == State.HOLD:
                self._began = int(causes[k])
            self._state, self._cause = state, int(causes[k])
            if state == State.ACTIVE:
                self._how, self._why, self._began = "acting", int(Cause.NONE), int(Cause.NONE)
            elif state == State.ARMED and self._how in ("never", "program"):  # again: what comes now is judged
                self._how, self._why = "armed", int(Cause.NONE)
            elif before in (State.ACTIVE, State.HOLD) and state == State.RAMP_OUT:
                words = {Cause.PROGRAM: "program", Cause.OPERATOR: "operator"}
                self._how, self._why = words.get(Cause(self._cause), "hold"), self._cause
            elif state == State.FAULT and before in (State.ARMED, State.ACTIVE, State.HOLD, State.RAMP_OUT):
                requested = self._cause == Cause.HELD_TOO_LONG and self._began == Cause.OPERATOR
                self._how, self._why = "stop disobeyed" if requested else "fault", self._cause
        if self._how == "program" and np.any(causes == Cause.ENABLE_LOST):  # it went on cutting
            self._how, self._why = "hold", int(Cause.ENABLE_LOST)

    def shown(self) -> dict[str, str]:
        """Who ended it (``by``) and why (``cause``).

        By program, operator, hold, fault; stop disobeyed: the operator's stop, at which the robot went on; acting: it
        still acts; armed: never switched on; never. ``held_for``: why a hold began that lasted too long.
        """
        out = {"by": self._how, "cause": Cause(self._why).name.lower()}
        if self._why == Cause.HELD_TOO_LONG and self._began:
            out["held_for"] = Cause(self._began).name.lower()
        return out


class RunCauses:
    """Causes of a run: of what happened from arming on, or, where it was never armed, of what kept it from that.

    What is lacking while the processes start one after the other, and what a robot that has ended no longer sends, is
    no cause of anything.
    """

    def __init__(self) -> None:
        self._state = int(State.IDLE)
        self._since: set[int] = set()
        self._before: set[int] = set()
        self._armed = False

    def add(self, rows: Float) -> None:
        """Look at further records.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`.
        """
        states = rows[:, column("out_state")].astype(int)
        causes, degraded = rows[:, column("out_cause")].astype(int), rows[:, column("out_degraded")].astype(int)
        before = np.concatenate([[self._state], states[:-1]])
        acts = states >= State.ARMED
        left = (before >= State.ARMED) & ~acts
        self._since |= set(causes[acts | left].tolist())
        self._since |= set(degraded[states == State.ACTIVE].tolist())
        self._armed = self._armed or bool(acts.any())
        self._state = int(states[-1])
        answered = ~acts & (rows[:, column("elapsed")] > 0)
        if answered.any():
            last = np.flatnonzero(answered)[-1]
            self._before = {int(causes[last]), int(rows[last, column("out_soft")])}

    @property
    def names(self) -> list[str]:
        """Their names."""
        causes = self._since if self._armed else self._before
        return sorted(Cause(one).name.lower() for one in causes if one)


def _missing(summary: Mapping[str, Any]) -> str:
    missing = summary.get("compared", {}).get("missing_most_mm")
    return f", but up to {missing:.2f} mm of the correction were missing at the robot" if missing else ""


def _never_why(summary: Mapping[str, Any]) -> str:
    """Reason why a run was never armed, where one number or fact says it."""
    off = summary.get("tracker_off")
    if summary.get("unanswered"):
        return (
            ": nothing was answered, because the correction that the loop before left at the robot is not known; end"
            " the robot program at the controller, which takes it away, then start the run and the program again"
        )
    if not summary["cycles"]:
        if not summary.get("malformed"):
            return ": no telegram came"
        return (
            f": none of {summary['malformed']} telegrams could be read: is this the robot's protocol, and does its"
            " controller send what the file of --rsi says?"
        )
    if "not_closed" in summary.get("causes", ()):
        return ": the loop before did not end by itself, and nobody has acknowledged that (counterflex operator reset)"
    return f": {offset_message(off)}" if off is not None else ""


def ended_how(summary: Mapping[str, Any], *, arm: bool) -> dict[str, Any]:
    """Exit status, name and words of the end of a run.

    Args:
        summary: ``loop_ended``, ``correction_ended``, ``records_lost``, ``log_trouble``, ``recorder_died``,
            ``holds_feed`` (the robot's link has a word for it),
            ``tracker_off`` (:func:`counterflex.protocols.session.tracker_off.tracker_off`), ``compared``
            (:func:`counterflex.protocols.session.comparison.compared`), ``another_port`` of a session that is not
            answered, ``unanswered`` telegrams because the correction at the robot was not known, ``causes`` by name.
        arm: It was started to correct.

    Returns:
        ``status``, the exit status; ``how``, the name of :class:`End`; ``said``, in words; ``wrong``: it is told also
        where a signal ended the run.
    """
    by, cause = summary["correction_ended"]["by"], summary["correction_ended"]["cause"].replace("_", " ")
    held_for = summary["correction_ended"].get("held_for", "").replace("_", " ")
    cause += f", for {held_for}" if held_for else ""
    lost, no_hold = summary["records_lost"], not summary.get("holds_feed", True)
    port, trouble = summary.get("another_port"), summary["log_trouble"]
    what = f"{lost} records are missing in the log" if lost else "the log is not whole"
    ends = (
        (
            port, End.FAULT,
            f"the controller began another session from its port {port}, which is not answered while the correction of"
            " the one before is in effect; start the run and the robot program again",
        ),
        (
            summary["loop_ended"] != AS_REQUESTED, End.DIED,
            f"the loop {summary['loop_ended']}: it did not end by itself, and ramped nothing out",
        ),
        (
            summary["recorder_died"], End.LOG_LOST,
            "the recorder died; the loop held the feed, ramped out and ended by itself",
        ),
        (by == "acting", End.FAULT, "the robot fell silent while the correction acted"),
        (
            by == "fault" or (by == "stop disobeyed" and not no_hold), End.FAULT,
            f"a fault ended the correction: {cause}",
        ),
        (by == "hold", End.FAULT, f"the correction was ended, not by the program: {cause}"),
        (lost or trouble, End.LOG_LOST, what + (f" ({trouble})" if trouble else "")),
        (by == "operator", End.STOPPED, "the correction was ended before the program ended it"),
        (
            by == "stop disobeyed", End.STOPPED,
            "the correction ended before its program; without a feed hold the robot was stopped",
        ),
    )  # fmt: skip
    end, sentence = next(((end, text) for holds, end, text in ends if holds), (End.PLANNED, ""))
    if not sentence and arm and by in ("never", "armed"):
        what = "never armed" if by == "never" else "armed, but the robot program never switched the correction on"
        end, sentence = End.NEVER_ARMED, what + _never_why(summary)
    sentence = sentence or "as planned" + _missing(summary)
    wrong = end in (End.DIED, End.FAULT, End.LOG_LOST)
    return {"status": int(end), "how": end.name.lower(), "said": sentence, "wrong": wrong}
