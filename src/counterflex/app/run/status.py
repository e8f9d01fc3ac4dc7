"""View of a run from outside, now and then: for the line that is shown while it goes on."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import NS
from counterflex.evaluate.process_record import ProcessEvent, ProcessRecord
from counterflex.files.logs.place import trouble_message
from counterflex.protocols.processes.control_array import Kept, Life, Shown, Tally
from counterflex.protocols.session.comparison import compared
from counterflex.protocols.session.tracker_off import offset_message, tracker_off
from counterflex.runtime.estimator.fusion import Source
from counterflex.runtime.record_ring import RESULTS, RecordRing, column
from counterflex.runtime.state.supervisor import Cause, State


@dataclass(frozen=True)
class Status:
    """Status of a run as seen from outside, now and then.

    Attributes:
        cause: Why.
        cycles: Answered.
        correction_um: (3,) of the tool, part axes.
        compute_us: Median time of a cycle since the last status.
        log_trouble: Why the log cannot be written, or empty.
        records_lost: So far.
        foreign: Telegrams from an address that is not the controller's, so far.
        sources: What the estimate rests on; nothing without an estimator.
        degraded: Why one of its sources is missing.
        events: Of the process, since the last status.
        speed: Share of the programmed speed that is asked for.
        feed_hold: A feed hold is asked for.
        tares: Zeros of the force sensor refused in a row; it is tried again until one is accepted.
        idle_n: What the sensor showed then.
        idle_nm: Likewise.
        trouble: What failed in the loop's own program, or empty.
        ages_s: Since the last telegram, good force and good pose, by source; None: nothing yet. Only those there are.
        place: On the plan, 0 to 1; None: not on it, or there is none.
        force_n: Measured, filtered; None without a sensor.
        planned_n: Planned there, through the same filter; None without a plan.
        still_s: For how long the loop has not said that it lives.
        rejected: Samples of the tracker that were rejected, so far.
        set_back: How often the tracker's clock was set back, so far.
        tracker_off: How far from the controller's pose the tracker sees the tool, and what to do, where that keeps the
            loop from being armed; else empty.
        compared: What robot, frames and plan show (:func:`counterflex.protocols.session.comparison.compared`).
        malformed: Telegrams that could not be read, so far.
    """

    state: State
    cause: Cause
    cycles: int
    correction_um: tuple[float, float, float]
    compute_us: float
    log_trouble: str
    records_lost: int = 0
    foreign: int = 0
    sources: Source = Source.NOTHING
    degraded: Cause = Cause.NONE
    events: tuple[ProcessEvent, ...] = ()
    speed: float = 1.0
    feed_hold: bool = False
    tares: int = 0
    idle_n: float = 0.0
    idle_nm: float = 0.0
    trouble: str = ""
    ages_s: tuple[tuple[str, float | None], ...] = ()
    place: float | None = None
    force_n: float | None = None
    planned_n: float | None = None
    still_s: float = 0.0
    rejected: int = 0
    set_back: int = 0
    tracker_off: str = ""
    compared: Mapping[str, float | None] = field(default_factory=dict)
    malformed: int = 0

    def force_message(self) -> str:
        """Advice where the force is off the plan in the cut, for the status line; empty where it is not."""
        if self.state < State.ACTIVE:
            return ""
        if Cause.FORCE_OFFSET in (self.cause, self.degraded):
            return "  FORCE STEPPED: look for another zero of the sensor, a hit, deeper stock, harder material"
        if Cause.FORCE_DISAGREES in (self.cause, self.degraded):
            return "  THE TWO FORCE SENSORS DIFFER: look for a zero that moved, a loose cable, a bridge, a wrong matrix"
        if self.degraded == Cause.FORCE_DIFFERS:
            return (
                "  FORCE OFF THE PLAN otherwise than in such cuts before, and followed: deeper stock or harder "
                "material; or the sensor's zero, which the next way in air shows"
            )
        return ""


class StatusReader:
    """Looks at the records and the shared numbers of a run, disturbing nobody.

    Args:
        ring: Name of the ring of records.
        control: Shared, see :mod:`counterflex.protocols.processes.control_array`.
    """

    def __init__(self, ring: str, control: Int) -> None:
        self._reader, self._control = RecordRing(ring), control
        self._seen = ProcessRecord()
        self._last: Float | None = None

    def close(self) -> None:
        """Leave the ring."""
        self._reader.close()

    def look(self, trouble: str = "") -> Status | None:
        """The status now; None before the first record.

        Args:
            trouble: What failed in the loop's own program.
        """
        rows, control = self._reader.take(), self._control
        events = self._seen.add(rows) if len(rows) else []
        if len(rows):
            self._last = rows[-1]
        last = self._last
        if last is None:
            return None
        now = time.monotonic_ns()
        off = tracker_off(control)
        x, y, z = (float(v) * 1e6 for v in last[RESULTS : RESULTS + 3])
        return Status(
            State(int(last[column("out_state")])),
            Cause(int(last[column("out_cause")]) or int(last[column("out_soft")])),
            int(control[Shown.CYCLES]),
            (x, y, z),
            float(np.median((rows[:, 2] - rows[:, 1]) * 1e-3)) if len(rows) else 0.0,
            trouble_message(int(control[Kept.TROUBLE])),
            int(control[Kept.LOST]),
            int(control[Tally.FOREIGN]),
            Source(int(last[column("out_sources")])),
            Cause(int(last[column("out_degraded")])),
            tuple(events),
            float(last[column("speed_asked")]),
            bool(last[column("out_feed_hold")]),
            int(control[Tally.TARES]),
            control[Tally.IDLE_MN] * 1e-3,
            control[Tally.IDLE_MNM] * 1e-3,
            trouble,
            tuple((name, age_s(int(control[place]), now)) for name, place in SOURCES if control[place] >= 0),
            _shared(int(control[Shown.PLACE_PPM]), 1e-6),
            _shared(int(control[Shown.FORCE_MN]), 1e-3),
            _shared(int(control[Shown.PLANNED_MN]), 1e-3),
            0.0 if control[Life.ENDED] else (now - int(control[Life.LOOP_NS])) * NS,
            int(last[column("out_rejected")]),
            int(control[Tally.TRACKER_SET_BACK]),
            "" if off is None else offset_message(off),
            compared(control),
            int(control[Tally.MALFORMED]),
        )


SOURCES = (("robot", Shown.ROBOT_NS), ("force", Shown.FORCE_NS), ("tracker", Shown.TRACKER_NS))


def age_s(then_ns: int, now_ns: int) -> float | None:
    """Seconds since then; None where it has not been yet."""
    return None if then_ns == 0 else max(0, now_ns - then_ns) * NS


def _shared(number: int, unit: float) -> float | None:
    return None if number < 0 else number * unit
