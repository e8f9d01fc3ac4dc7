"""Status of a session in every cycle, in shared numbers: tallies, state, ages, place, force."""

from __future__ import annotations

import math
import struct
from typing import Final

from counterflex.core.arrays import Int
from counterflex.core.units import DEG
from counterflex.protocols.processes.control_array import REQUESTS, Life, Shown, Tally
from counterflex.protocols.robot.port import Counters
from counterflex.protocols.session.tare import Tare
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import AxisCheck
from counterflex.runtime.state.states import State

_TALLIES: Final = struct.Struct(f"{len(Tally)}q")
_SHOWN: Final = struct.Struct(f"{len(Shown)}q")
"""Numbers that are written at once: three times as fast as a part of an array."""
_TALLIES_AT: Final = 8 * REQUESTS
_SHOWN_AT: Final = 8 * min(Shown)
_LOOP: Final = int(Life.LOOP_NS)
_NOTHING: Final = -1
_MOST: Final = 2.0**62
"""Largest number that is shown."""
_NOW_AND_THEN: Final = 25
"""Cycles from one reading of what changes slowly to the next."""


class Teller:
    """Writes into the shared array.

    Args:
        control: See :mod:`counterflex.protocols.processes.control_array`.
        loop: As the cycle left it.
        counters: Of the robot's link.
        tare: Zero of the force sensor.
        force: There is a force sensor.
        tracker: There is a tracker.
        angles: Axis angles against poses, or None.
    """

    def __init__(
        self,
        control: Int,
        loop: Loop,
        counters: Counters,
        tare: Tare,
        *,
        force: bool,
        tracker: bool,
        angles: AxisCheck | None = None,
    ) -> None:
        self._control, self._counters, self._tare, self._loop = control, counters, tare, loop
        self._result, self._tests = loop.quick_result, loop.quick_tests
        self._correction, self._measured = loop.correction.data, loop.result.measured.data  # read faster than arrays
        self._planned = loop.planned_force.data
        self._rows = loop.plan_rows - 1 if loop.planned else 0
        self._force_ns, self._tracker_ns = (0 if force else _NOTHING), (0 if tracker else _NOTHING)
        self._robot_ns, self._angles, self._given = 0, angles, loop.quick_given
        self._missing_most_nm = _NOTHING
        self._slowly = (_NOTHING,) * 5
        limits = loop.settings.plausibility
        self._plan_cycles = max(1, round(2.0 * limits.settle_s / loop.settings.period_s))
        self._frame_nm, self._frame_udeg = round(1e9 * limits.frame_m), round(1e6 * limits.frame_rad / DEG)
        control[Shown.TRACKER_OFF_NM] = control[Shown.TRACKER_TURN_UDEG] = _NOTHING
        control[Shown.FORCE_NS], control[Shown.TRACKER_NS] = self._force_ns, self._tracker_ns
        control[Shown.PLACE_PPM] = _NOTHING
        control[Shown.FORCE_MN], control[Shown.PLANNED_MN] = self._force_ns, 0 if self._rows else _NOTHING

    def tell(
        self,
        now_ns: int,
        *,
        received: bool,
        cycles: int,
        clock_jumps: int,
        set_back: int,
        force_age: int,
        tracker_age: int,
        spikes: int = 0,
    ) -> None:
        """Tell of a cycle.

        Args:
            now_ns: Monotonic.
            received: There was a telegram.
            cycles: Telegrams so far.
            clock_jumps: How often the clocks parted.
            set_back: How often the tracker's clock was set back.
            force_age: Cycles since the last good force.
            tracker_age: Cycles since the last good pose.
            spikes: Of the force sensor, left out so far.
        """
        counters, tare, words = self._counters, self._tare, self._control.data
        fx, fy, fz, mx, my, mz = tare.mean.tolist()
        _TALLIES.pack_into(
            words,
            _TALLIES_AT,
            counters.foreign,
            counters.malformed,
            counters.old + counters.astray,
            counters.drained,
            counters.lost,
            counters.late_at_robot,
            clock_jumps,
            set_back,
            tare.refusals,
            _whole(1e3, fx, fy, fz),
            _whole(1e3, mx, my, mz),
        )
        if received:
            self._robot_ns = now_ns
        if force_age == 0 and self._force_ns != _NOTHING:
            self._force_ns = now_ns
        if tracker_age == 0 and self._tracker_ns != _NOTHING:
            self._tracker_ns = now_ns
        result, planned = self._result, self._planned
        place = self._loop.place
        _SHOWN.pack_into(
            words,
            _SHOWN_AT,
            result.state,
            result.cause or result.soft,
            result.hard,
            result.feed_hold,
            _whole(1e9, *self._correction[:3]),
            cycles,
            self._robot_ns,
            self._force_ns,
            self._tracker_ns,
            round(1e6 * place / self._rows) if self._rows and place >= 0.0 else _NOTHING,
            _NOTHING if self._force_ns == _NOTHING else _whole(1e3, *self._measured[:3]),
            _whole(1e3, *planned[:3]) if self._rows else _NOTHING,
            *self._tracker_off(),
            *self._missing(),
            *self._slow(cycles),
            spikes,
        )
        self._control[_LOOP] = now_ns

    def _missing(self) -> tuple[int, int]:
        """Return what is missing of the correction at the robot, and the largest so far."""
        if self._given.is_reported == 1:
            self._missing_most_nm = max(0, self._missing_most_nm)
        if self._tests.short == 0:
            return 0, self._missing_most_nm
        missing = _whole(1e9, *self._tests.missing)
        self._missing_most_nm = max(missing, self._missing_most_nm)
        return missing, self._missing_most_nm

    def _slow(self, cycles: int) -> tuple[int, int, int, int, int]:
        """Return what changes slowly, read now and then: reading it takes longer than the rest."""
        if cycles % _NOW_AND_THEN == 0:
            self._slowly = *self._frame(), *self._plan()
        return self._slowly

    def _frame(self) -> tuple[int, int]:
        """Offset of the frames, position and angle."""
        if self._angles is None or not self._angles.learnt:
            return _NOTHING, _NOTHING
        offset = self._angles.offset
        return _whole(1e9, *offset[:3]), _whole(1e6 / DEG, *offset[3:])

    def _plan(self) -> tuple[int, int, int]:
        """Place, feed and force against the plan."""
        tests = self._tests
        if not self._rows or tests.plan_cycles < self._plan_cycles:
            return _NOTHING, _NOTHING, _NOTHING
        judged = self._loop.monitor.results.ratio > 0.0  # else nothing shows the force, and none is told as planned
        force_ppm = _shown(1e6 * tests.plan_force) if judged else _NOTHING
        return _shown(1e9 * tests.plan_place), _shown(1e6 * tests.plan_feed), force_ppm

    def _tracker_off(self) -> tuple[int, int, int, int]:
        """Distance, its limit, angle, its limit; -1 for what was found where that does not keep the loop idle."""
        if self._tests.frame != 1 or self._result.state >= State.ARMED:
            return _NOTHING, self._frame_nm, _NOTHING, self._frame_udeg
        tests = self._tests
        distance = _whole(1e9, *tests.deviation)
        return distance, self._frame_nm, _whole(1e6 / DEG, *tests.turn), self._frame_udeg


def _whole(units: float, x: float, y: float, z: float) -> int:
    return _shown(units * math.hypot(x, y, z))


def _shown(x: float) -> int:
    """Whole number that fits into a shared word: a damaged telegram may hold any number, and ends no loop."""
    return round(max(-_MOST, min(_MOST, x))) if math.isfinite(x) else _NOTHING
