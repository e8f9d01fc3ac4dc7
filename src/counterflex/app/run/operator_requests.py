"""Requests of an operator while a run goes on: its state, a stop, a reset, to be armed; and what came of them.

Asked of the loop itself, by numbers that it shares: the processes that log and show may be dead or stand still. Imports
nothing that is slow to load, because a stop must not wait for it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from counterflex.core.errors import InputError, OutputError
from counterflex.files.logs.place import trouble_message
from counterflex.files.machine_file import machine_file
from counterflex.protocols.processes.actions import note_command
from counterflex.protocols.processes.control_array import Kept, Life, Request, Shown, Tally
from counterflex.protocols.processes.operator_words import find
from counterflex.protocols.session.tracker_off import tracker_off
from counterflex.runtime.state.states import Cause, State

ACTIONS: Final = ("status", "stop", "reset", "arm")
WAIT_S: Final = 0.3
"""When it is looked what came of a request that has had no effect before."""
BEAT_S: Final = 0.1
"""Within this a loop that lives has said so again: it does 20 times a second."""
SILENT_S: Final = 1.0
"""A loop that has said nothing for so long has died or stands still; it says 20 times a second that it lives."""
_POLL_S: Final = 0.002
_NS: Final = 1e-9
_SOURCES: Final = {"robot": Shown.ROBOT_NS, "force": Shown.FORCE_NS, "tracker": Shown.TRACKER_NS}


@dataclass(frozen=True)
class Clock:
    """Time as the operator's side keeps it; a test gives its own.

    Attributes:
        now_ns: Monotonic, the clock of the loop.
        wait: Waits for so many s.
    """

    now_ns: Callable[[], int] = time.monotonic_ns
    wait: Callable[[float], None] = time.sleep


def ask(words: Any, action: str, *, where: str = "", clock: Clock | None = None) -> dict[str, Any]:
    """Ask something of a loop, and look what came of it.

    Args:
        words: Shared, see :mod:`counterflex.protocols.processes.control_array`.
        action: One of :data:`ACTIONS`.
        where: Folder of the run, for messages.
        clock: Or None for the computer's.

    Returns:
        See :func:`request`.

    Raises:
        InputError: No such request.
        OutputError: The loop has died or stands still. A stop stays asked for.
    """
    if action not in ACTIONS:
        raise InputError("no such request", value=action, limit=", ".join(ACTIONS))
    clock = clock if clock is not None else Clock()
    begin = clock.now_ns()
    before = State(words[Shown.STATE])
    refused = ""
    if action == "stop":
        words[Request.STOP] = 1
    _require_living(words, begin, where)
    if action == "reset":
        words[Request.RESET] = 1
    elif action == "arm":
        refused = _may_not_arm(words, before)
        if not refused and before == State.READY:  # armed already: there is nothing to ask for, and no stop to undo
            words[Request.STOP] = 0
            words[Request.ARM] = 1
    while action != "status" and not refused and not _done(words, action, begin):
        if (clock.now_ns() - begin) * _NS > WAIT_S:
            refused = _why_not(words, action)
            if action == "arm" and _armed_after_all(words, clock):
                refused = ""
            break
        clock.wait(_POLL_S)
    took_ms = round((clock.now_ns() - begin) * 1e-6, 2)
    return {
        "done": not refused,
        "refused": refused,
        **_looks(words, clock.now_ns()),
        "took_ms": took_ms,
    }


def _require_living(words: Any, now_ns: int, where: str) -> None:
    silent_s = (now_ns - words[Life.LOOP_NS]) * _NS
    if silent_s > SILENT_S:
        raise OutputError(
            "the loop does not answer: its process has died or stands still",
            where=where or None,
            value=f"{silent_s:.1f} s without a sign of life",
            hint="Stop the robot at its controller; without answers it stops by its own time-out",
        )


def _may_not_arm(words: Any, state: State) -> str:
    if not words[Life.MAY_ARM]:
        return "the run only watches: start it with --arm"
    return (
        ""
        if state in (State.READY, State.ARMED, State.ACTIVE)
        else f"not ready, but {state.name.lower().replace('_', ' ')}"
    )


def _done(words: Any, action: str, begin_ns: int) -> bool:
    state = words[Shown.STATE]
    if words[Life.LOOP_NS] <= begin_ns:
        return False
    if action == "stop":
        return state not in (State.ARMED, State.ACTIVE)  # in the cut it is held first, and ramped out as it stands
    if action == "reset":
        return not words[Request.RESET] and state != State.FAULT
    return bool(state in (State.ARMED, State.ACTIVE))


def _why_not(words: Any, action: str) -> str:
    """Reason for which a request had no effect; one that waits for something else is taken back, but never a stop."""
    if action == "stop":
        return "not stopped yet: no telegram of the robot has come since; the loop does it with the next one"
    if action == "arm":
        words[Request.ARM] = 0
        if words[Shown.FEED_HOLD]:
            return "feed hold: acknowledge the cause first (counterflex operator reset)"
        return "a check fails, or the robot program has switched the correction on already"
    if words[Request.RESET]:
        words[Request.RESET] = 0
        return "no telegram of the robot has come since"
    if words[Shown.CORRECTION_NM] > 0:
        return "a correction is in force at the robot: end the robot program first"
    cause = Cause(words[Shown.HARD] or words[Shown.CAUSE])
    return f"its cause is still there: {cause.name.lower().replace('_', ' ')}"


def _armed_after_all(words: Any, clock: Clock) -> bool:
    """Return whether the loop took the request while it was taken back: its next sign of life shows it."""
    begin = clock.now_ns()
    while words[Life.LOOP_NS] <= begin and (clock.now_ns() - begin) * _NS <= BEAT_S:
        clock.wait(_POLL_S)
    return State(words[Shown.STATE]) in (State.ARMED, State.ACTIVE)


def _measured(word: int, digits: int, unit: float) -> float | None:
    """Return a measured value; one below 0 says that there is none."""
    return round(word * unit, digits) if word >= 0 else None


def _looks(words: Any, now_ns: int) -> dict[str, Any]:
    ages = {
        name: None if words[place] == 0 else round((now_ns - words[place]) * 1e-6, 1)
        for name, place in _SOURCES.items()
        if words[place] >= 0
    }
    return {
        "state": State(words[Shown.STATE]).name.lower(),
        "cause": Cause(words[Shown.CAUSE]).name.lower(),
        "feed_hold": bool(words[Shown.FEED_HOLD]),
        "correction_mm": round(words[Shown.CORRECTION_NM] * 1e-6, 4),
        "robot_heard": words[Shown.CYCLES] > 0,
        "cycles": words[Shown.CYCLES],
        "age_ms": ages,
        "place": _measured(words[Shown.PLACE_PPM], 4, 1e-6),
        "force_n": _measured(words[Shown.FORCE_MN], 1, 1e-3),
        "planned_n": _measured(words[Shown.PLANNED_MN], 1, 1e-3),
        "tracker_off": tracker_off(words),
        "foreign": words[Tally.FOREIGN],
        "log_trouble": trouble_message(words[Kept.TROUBLE]),
        "records_lost": words[Kept.LOST],
    }


def request(folder: str | Path, action: str) -> dict[str, Any]:
    """Ask something of the run whose log lies in a folder.

    Args:
        action: One of :data:`ACTIONS`.

    Returns:
        ``done``, or why not (``refused``); ``state``, ``cause``, ``feed_hold``, ``correction_mm``, ``robot_heard``,
        ``cycles``; ``age_ms`` of each source (None: nothing yet); ``place`` on the plan, 0 to 1, ``force_n`` measured
        and ``planned_n`` there (None: not known); ``tracker_off`` of
        :func:`counterflex.protocols.session.tracker_off.tracker_off`; ``foreign`` telegrams dropped; ``log_trouble``,
        ``records_lost``; ``took_ms`` from the request to its effect.

    Raises:
        InputError: No such request.
        FileFormatError: No run goes on there.
        OutputError: The loop does not answer.
    """
    if action not in ACTIONS:
        raise InputError("no such request", value=action, limit=", ".join(ACTIONS))
    with find(Path(folder), machine_file().parent) as shared:
        answer = ask(shared.words, action, where=str(folder))
        if action != "status":
            note_command(shared.path, action, answer)
        return answer
