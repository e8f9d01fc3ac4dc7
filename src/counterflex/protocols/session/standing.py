"""Correction that stands at a robot whose loop was killed: found before its telegrams are answered again.

A controller goes on with the correction that it was told last. The next loop must begin with that one, and ramp it out
where the robot stands; zero would be a step. A controller that was started again has none in force, and that one would
be a step there. Counter and reported pose tell both from each other::

    counter goes on     reported pose       the loop begins with
    yes                 none, or at last    the last answer, in HOLD
    any                 at last             the last answer, in HOLD
    any                 without correction  zero
    no                  none                zero
    else                                    nothing is answered until the session has ended
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MS, NS
from counterflex.protocols.processes.last_answer import Answered
from counterflex.robot.elasticity.kernels.records import WORK
from counterflex.runtime.loop import Loop
from counterflex.runtime.settings import Output
from counterflex.runtime.state.supervisor import Cause, State
from counterflex.runtime.step.supervise import RESOLVED_M, SESSION_S


@dataclass(frozen=True)
class SessionChecks:
    """Conditions that must hold before the correction may be armed."""

    settle_cycles: int = 60  # good telegrams in a row
    force_n: float = 15.0  # largest force that the sensor may show after its weight is taken off, without a cut (R17)
    moment_nm: float = 5.0  # largest moment
    tare: bool = True  # take what then remains as zero, over 0.2 s; what is too much is tried again until it is not
    # a log that is lost while the correction acts is a hold; else it is told, and goes on. It is never armed without
    # one
    hold_without_log: bool = False
    # the loop is armed, and the correction acts, only while an operator panel says that it lives; else none is needed,
    # and one that dies is told
    hold_without_panel: bool = False
    # number of the job that the robot program must say it is of, where it says one (job_number); 0: none, the program
    # is not a compensated one. None: not tested
    job: int | None = None
    # the process that started the loop says many times a second that it lives; silent for so long it counts as lost.
    # Not tested where nobody has ever said so, and None: never, a robot that waits for every answer has time. A process
    # that has died is seen by the operating system, see Living
    run_silent_s: float | None = 0.08


_SEEN: Final = 3
"""Telegrams in which the direction of the motion is looked for: along it the robot trails its program."""
_MOVES_M: Final = 5e-6
"""Shorter ways are rounding of the telegrams."""
_APART_S, _APART_SHARE = 0.5, 0.1
"""By which the controller's counter may leave this computer's clock since the last answer: clocks drift and jump."""
_OFF_M, _OFF_SHARE = 0.15e-3, 0.3
"""Distance of a reported pose from where a correction has the tool, at most; a share of its size where that is more."""
_COUNTS: Final = 1 << 32
_PER_FILTER: Final = 4


class Standing:
    """Finds the correction that stands.

    Args:
        before: Last answer of the loop before; None where it is lost.

    Attributes:
        known: Nothing more is looked for.
        correction: (6,) and
        axes: (6,) that stand, where they are known; zero where none is in force.
        way: (3,) m of the commanded point in a cycle.
    """

    def __init__(self, before: Answered | None) -> None:
        self._before = before
        self.known = False
        self.correction: Float = np.zeros(6)
        self.axes: Float = np.zeros(6)
        self.way: Float = np.zeros(3)
        self._seen: list[Float] = []
        self._silent_s = 0.0

    def silent(self, period_s: float) -> None:
        """A cycle without a telegram: a session that is silent for long has ended, and nothing is in force then."""
        self._silent_s += period_s
        self.known = self.known or (bool(self._seen) and self._silent_s > SESSION_S)

    def see(self, counter: int, now_ns: int, nominal: Float, measured: Float | None, *, restarted: bool) -> None:
        """Look at a telegram.

        Args:
            counter: Of the controller, ms.
            now_ns: When it came, monotonic.
            nominal: (12,) commanded pose without correction.
            measured: (12,) pose that the controller reports, or None.
            restarted: It is of another session than the telegram before.
        """
        self._silent_s = 0.0
        if restarted or (self._before is not None and not self._before.correction.any()):
            self.known = True
            return
        self._seen = [*self._seen[1 - _SEEN :], nominal[9:].copy()]
        if self._before is None or len(self._seen) < _SEEN:
            return
        way = self._seen[-1] - self._seen[0]
        self.way = way / (_SEEN - 1)
        sent = self._before.correction[:3]
        size, goes_on = float(np.linalg.norm(sent)), _goes_on(self._before, counter, now_ns)
        if measured is None or size < RESOLVED_M:
            self._decide(stands=goes_on)
            return
        shown = measured[9:] - nominal[9:]
        off_sent, off_none = _across(shown - sent, way), _across(shown, way)
        if min(off_sent, off_none) <= max(_OFF_M, _OFF_SHARE * size):
            self._decide(stands=off_sent <= off_none)

    def _decide(self, *, stands: bool) -> None:
        self.known = True
        if stands and self._before is not None:
            self.correction, self.axes = self._before.correction, self._before.axes


def _goes_on(before: Answered, counter: int, now_ns: int) -> bool:
    """Return whether the controller's counter has gone on with this computer's clock since the answer."""
    gone_s = (now_ns - before.clock_ns) * NS
    counted_s = ((counter - before.counter + _COUNTS // 2) % _COUNTS - _COUNTS // 2) * MS
    return counted_s >= 0.0 and abs(counted_s - gone_s) <= _APART_S + _APART_SHARE * gone_s


def _across(v: Float, way: Float) -> float:
    """Length of what of a vector lies across a way."""
    length = float(np.linalg.norm(way))
    if length > _MOVES_M:
        v = v - (v @ way / length**2) * way
    return float(np.linalg.norm(v))


def begin_held(loop: Loop, standing: Standing) -> None:
    """Begin a loop anew in HOLD with the correction that stands at the robot; its end is asked for.

    The robot has made all of it long ago, on its way here: what the loop remembers of the past says so.

    Args:
        loop: Its inputs hold pose and angles of the newest telegram.
        standing: The correction; where axis angles are sent they count, as the robot has gone on with them.
    """
    correction, axes, nominal = standing.correction, standing.axes, loop.given.nominal.copy()
    if loop.settings.output == Output.AXES and not loop.holds_part:
        correction = _of_axes(loop, axes)
    loop.reset()
    record = loop.records[0]
    state, ring, result = loop.step_state, record["ring"][0], loop.quick_result
    state.correction[:] = state.in_effect[:] = correction
    state.answer_filter[:] = np.repeat(correction, _PER_FILTER)
    state.axes[:] = axes
    ring["sent"][:] = ring["in_effect"][:] = correction
    ring["nominal"][:] = nominal
    ring["nominal"][:, 9:] -= (-np.arange(len(ring)) % len(ring))[:, None] * standing.way
    supervisor = state.supervisor
    supervisor.state, supervisor.cause = int(State.HOLD), int(Cause.NOT_CLOSED)
    supervisor.feed_hold = supervisor.ending = 1
    loop.correction[:], loop.axes[:] = correction, axes
    result.state, result.cause, result.feed_hold = supervisor.state, supervisor.cause, 1


def _of_axes(loop: Loop, axes: Float) -> Float:
    """Correction (6,) of the tool, part axes, that changes of the axis angles make where the robot is now."""
    loop.run()  # which leaves the Jacobian
    jacobian = loop.memory["scratch"].view(WORK)["jacobian"][0].reshape(6, 6)
    R_base_part = loop.records[0]["settings"][0].R_base_part.reshape(3, 3)
    out: Float = ((jacobian @ axes).reshape(2, 3) @ R_base_part).reshape(6)
    return out
