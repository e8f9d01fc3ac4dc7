"""Plan as the online loop knows it: points, planned forces, what the program contains already."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.records import Records, records
from counterflex.runtime.monitoring.override_plan import SpeedPlan, speed_plan
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.plan import monitor_plan
from counterflex.runtime.monitoring.settings import MonitorSettings
from counterflex.runtime.primitives.localize import SEEK_ROWS
from counterflex.runtime.settings import OnlineSettings
from counterflex.runtime.state.planned import PLAN
from counterflex.signals.preview import Ahead


@dataclass(frozen=True, eq=False)
class LoopPlan:
    """The program as the loop knows it; n rows, part frame, SI."""

    p_part: Float  # (n, 3) points as the program sends them (its correction included)
    time_s: Float  # (n,) planned time, not decreasing
    w_tcp_part: Float  # (n, 6) predicted wrench on the tool about its tip
    cutting: Float  # (n,) 1 where material is cut
    contained: Float  # (n, 6) correction that the program already contains, m and rotation vector
    # (n, 3) m, correction to be sent here so that the robot, as slow as it is, undoes play and friction in time, as
    # play_compensation gives it; None is none
    undo_play: Float | None = None
    turn_per_s: Float | None = None  # (n,) spindle speed, turns per second; None is not known
    tool: Int | None = None  # (n,) number of the tool; None is one and the same
    teeth: Int | None = None  # (n,) of the tool; None is not known
    chip_m: Float | None = None  # (n,) mean chip thickness where it cuts, else NaN; None is not known
    # (n, 3) correction across the feed that the loop will want at this place; None is not known
    need_m: Float | None = None
    # (n,) size of the error that the program itself is predicted to leave; None is not known
    residual_m: Float | None = None
    # (n, 6) wrench whose deflection is to be commanded here so that the robot, as slow as it is, undoes the predicted
    # one in time; None reads the predicted wrench ahead by the lead instead
    w_ahead_part: Float | None = None
    # (n, 6) wrench that would bend the robot as far as its drives yield here; it is in the one to be commanded. None is
    # nothing
    w_lost_part: Float | None = None
    ahead: Ahead | None = None  # how that was made from the predicted wrench; None is not known
    # (n,) share of the programmed speed at which the program is to run; None is 1 everywhere
    speed: Float | None = None

    def packed(self) -> Records:
        """(n,) PLAN for the step, with feed directions.

        Raises:
            InputError: Fewer than two rows, wrong shapes, numbers that are not finite, time that runs backwards.
        """
        p = as_float("plan: p_part", self.p_part, (None, 3))
        n = len(p)
        if n < 2:
            raise InputError("a plan needs two points", value=n)
        time = as_float("plan: time_s", self.time_s, (n,))
        if np.any(np.diff(time) < 0.0):
            raise InputError("time of the plan runs backwards", value=f"row {int(np.argmin(np.diff(time))) + 1}")
        out = records(PLAN, n)
        out["point"] = p
        out["time"] = time
        out["wrench"] = as_float("plan: w_tcp_part", self.w_tcp_part, (n, 6))
        ahead = self.w_tcp_part if self.w_ahead_part is None else self.w_ahead_part
        out["ahead"] = as_float("plan: w_ahead_part", ahead, (n, 6))
        out["cut"] = as_float("plan: cutting", self.cutting, (n,))
        contained = out["contained"] = as_float("plan: contained", self.contained, (n, 6))
        if self.undo_play is not None:
            out["play"] = as_float("plan: undo_play", self.undo_play, (n, 3))
        step_p = np.diff(p - contained[:, :3], axis=0)
        length = np.linalg.norm(step_p, axis=1, keepdims=True)
        out["direction"][:-1] = step_p / np.where(length > 0.0, length, 1.0)
        out["direction"][-1] = out["direction"][-2]
        return out

    def watched(self, settings: MonitorSettings) -> Records:
        """The plan as the monitor needs it, see :func:`counterflex.runtime.monitoring.plan.monitor_plan`."""
        n = len(self.p_part)
        turn = np.zeros(n) if self.turn_per_s is None else as_float("plan: turn_per_s", self.turn_per_s, (n,))
        none = np.zeros(n, dtype=np.int64)
        tool = none if self.tool is None else self.tool
        teeth = none if self.teeth is None else self.teeth
        return monitor_plan(self.packed(), settings, turn, teeth, tool)

    def speeds(self, settings: OnlineSettings, override: OverrideSettings, exponent: float = 0.0) -> SpeedPlan:
        """Speeds at which the predicted remaining error stays within a tolerance, see :func:`speed_plan`."""
        shaped = self.ahead if settings.pilot.lead_s is None else None
        return speed_plan(self.time_s, self.need_m, self.residual_m, settings, override, shaped, exponent)

    def at_speeds(self, settings: OnlineSettings, override: OverrideSettings, exponent: float) -> LoopPlan:
        """The same program, slowed down where the correction could not follow.

        What is to be commanded ahead of time is shaped again for the slower program and its smaller force. It is
        stored as at full speed: the loop multiplies it by the speed's power ``exponent`` as all of the plan's forces.

        ``override``: tolerance, least speed, rate; ``exponent``: of the force in the feed.
        """
        slowed = self.speeds(settings, override, exponent)
        ahead = self.w_ahead_part
        if self.ahead is not None and ahead is not None and np.any(slowed.speed < 1.0):
            smaller = slowed.speed[:, None] ** exponent
            lost = 0.0 if self.w_lost_part is None else self.w_lost_part
            ahead = self.ahead.command(self.w_tcp_part * smaller, slowed.time_s, lost) / smaller
        return replace(self, speed=slowed.speed, w_ahead_part=ahead)


def feeds_about(plan: Records, place: Float, way_m: float) -> Float:
    """(n, 3) unit feed directions of a plan up to a way behind and ahead of a place, part axes.

    Args:
        plan: PLAN, as :meth:`LoopPlan.packed`.
        place: (2,) row and fraction; row below 0: not known, and there are none.
        way_m: Along the plan, m.
    """
    row = int(place[0])
    near = plan[max(0, row - SEEK_ROWS) : row + SEEK_ROWS] if row >= 0 else plan[:0]
    p: Float = near["point"]
    way = np.cumsum(np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1))
    feeds: Float = near["direction"][np.abs(way - way[min(row, SEEK_ROWS)]) <= way_m] if len(near) else np.zeros((0, 3))
    return feeds[np.any(feeds != 0.0, axis=1)]
