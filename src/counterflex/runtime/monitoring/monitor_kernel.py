"""Process monitoring: one call per cycle after the step. Pure; the same inputs give the same outputs bit for bit.

Force in the feed frame, measured and predicted through the same filter (two equal first-order stages, whose impulse
response is nowhere negative: what is between two bounds stays between the filtered bounds), and five detectors:

- *missing cut*: the plan's least force about here, less the model's error, lies above twice the noise, and the measured
  size lies below once the noise, over a length of path. Both hypotheses then err at the same stated rate.
- *overload*: measured size above the plan's largest force about here times ``1 + model error``, plus noise, plus
  margin; or the force (moment) of a cycle above the limit of spindle and tool.
- *wear*: cumulative sum and trend of the ratio, :mod:`counterflex.runtime.monitoring.wear`.
- *breakage*: in a stretch that the plan says is steady the ratio drops at once, and lines of the spindle between the
  tooth passing rise: by a share of what one tooth carries (:func:`counterflex.runtime.monitoring.plan.lost_tooth`).
  Without that sign it is thinner stock, unless hardly any force is left; by half where the two cannot be told apart.
- *chatter*: energy of the samples that is neither slow nor a harmonic of the spindle, against what it is out of the
  cut, plus a share of the largest force to be expected and of the lines, plus what slow or changing force leaves in it.
- *low chatter*: slow vibration of the force that does not die away where the plan is steady.

What the sensor shows without a cut is learnt out of the cut, :mod:`counterflex.runtime.monitoring.air_noise`.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.runtime.monitoring.air_noise import follow_motion, learn_quiet, noise, quiet_force, two_stages
from counterflex.runtime.monitoring.detectors import breakage, chatter, judge, low_chatter, wear
from counterflex.runtime.monitoring.events import EVENTS, Event
from counterflex.runtime.monitoring.records import MONITOR_TYPES
from counterflex.runtime.monitoring.spindle_lines import estimate_folded
from counterflex.runtime.monitoring.wear import new_tool
from counterflex.runtime.primitives.causes import next_cause
from counterflex.runtime.state.supervisor import Cause, State

LEAST_SINE = 0.02
"""Sine of the angle between feed and tool axis below which they give no direction across: plunging."""


@kernel("void(float64, float64, float64, float64, float64, float64, float64[::1], float64[::1])")
def feed_frame(vx: float, vy: float, vz: float, ax: float, ay: float, az: float, memory: Float, frame: Float) -> None:
    """Right-handed axes of the feed: t along it, n = a x t across it, b = t x n.

    On a level path b is the tool axis, and n points to the left of the feed seen from the spindle (the tool's z points
    out of the spindle, so ``a`` is minus that). Where the feed runs along the tool, n is kept from before, made square
    to the feed; a path that plunges and goes on has one continuous frame. Where nothing moves the last feed counts.

    ``vx``: unit feed direction, part axes; zero where nothing moves. ``ax``: unit vector from the tool tip towards the
    spindle. ``memory``: (6,) last t and n; zeros at the start. Changed. ``frame``: (9,) written: t, n, b by rows;
    orthonormal.
    """
    if vx * vx + vy * vy + vz * vz < 0.25:
        vx, vy, vz = memory[0], memory[1], memory[2]
        if vx * vx + vy * vy + vz * vz < 0.25:
            vx, vy, vz = 1.0, 0.0, 0.0
    nx, ny, nz = ay * vz - az * vy, az * vx - ax * vz, ax * vy - ay * vx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    if size < LEAST_SINE:
        along = memory[3] * vx + memory[4] * vy + memory[5] * vz
        nx, ny, nz = memory[3] - along * vx, memory[4] - along * vy, memory[5] - along * vz
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        if size < 0.1:  # nothing from before, or the feed turned into it: any direction square to the feed
            if abs(vx) <= abs(vy) and abs(vx) <= abs(vz):
                nx, ny, nz = 1.0 - vx * vx, -vx * vy, -vx * vz
            elif abs(vy) <= abs(vz):
                nx, ny, nz = -vx * vy, 1.0 - vy * vy, -vy * vz
            else:
                nx, ny, nz = -vx * vz, -vy * vz, 1.0 - vz * vz
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / size, ny / size, nz / size
    frame[0], frame[1], frame[2] = vx, vy, vz
    frame[3], frame[4], frame[5] = nx, ny, nz
    frame[6], frame[7], frame[8] = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
    for k in range(6):
        memory[k] = frame[k]


AIR_N: Final = 1.0
"""Largest predicted force that still is no cut."""
LEAP_M: Final = 10e-3
"""The place on the plan was sought anew where it went farther than this in a cycle."""
RATE_S: Final = 0.04
_MISSING, _OVERLOAD, _WEAR = int(Event.MISSING_CUT), int(Event.OVERLOAD), int(Event.WEAR)
_FIRST_CAUSE = int(Cause.PROCESS_MISSING_CUT)
_ARMED, _FAULT = int(State.ARMED), int(State.FAULT)


@kernel("boolean(Given)", **MONITOR_TYPES)
def _goes_on(given: Record) -> bool:
    """A telegram came, and its pose is numbers: feed and place can be judged."""
    good = given.elapsed > 0
    for k in range(12):
        good = good and math.isfinite(given.nominal[k])
    return bool(good)


@kernel("boolean(Given, Settings)", **MONITOR_TYPES)
def _is_read(given: Record, s: Record) -> bool:
    """The force is numbers and fresh."""
    good = given.force_age < s.stale_cycles
    for k in range(6):
        good = good and math.isfinite(given.wrench[k])
    return bool(good)


@kernel("float64(Memory, Settings, PlanRow, PlanRow, float64, int64)", **MONITOR_TYPES)
def _progress(m: Record, s: Record, here: Record, there: Record, u: float, elapsed: int) -> float:
    """Way along the plan since the last cycle, m; follows its speed by the programmed one."""
    time = (1.0 - u) * here.time + u * there.time
    distance = (1.0 - u) * here.distance + u * there.distance
    moved = 0.0
    if m.started == 1:
        moved = max(0.0, distance - m.last_distance)
        moved = moved if moved < LEAP_M else 0.0
        rate = max(0.0, time - m.last_time) / (elapsed * s.period)
        decay = math.exp(-s.period / RATE_S)
        m.rate = decay * m.rate + (1.0 - decay) * min(rate, 2.0)
    else:
        m.rate, m.started = 1.0, 1
    m.last_time, m.last_distance = time, distance
    m.results.distance = distance
    return moved


@kernel("void(Memory, Settings, PlanRow, PlanRow, float64, boolean)", **MONITOR_TYPES)
def _expect(m: Record, s: Record, here: Record, there: Record, u: float, planned: bool) -> None:
    """Predicted force of this cycle and its bounds at the present speed."""
    now = m.now
    now.force[:] = 0.0
    now.lowest = now.highest = 0.0
    if planned:
        slower = min(max(m.rate, 0.0), 1.5) ** s.exponent
        for k in range(3):
            now.force[k] = ((1.0 - u) * here.force[k] + u * there.force[k]) * slower
        now.lowest = min(here.lowest, there.lowest) * slower
        # going slower never narrows the bound
        now.highest = max(here.highest, there.highest) * max(1.0, slower)


@kernel("float64(Memory, Settings, Given)", **MONITOR_TYPES)
def _filter_forces(m: Record, s: Record, given: Record) -> float:
    """Forces through the filter, in the feed frame, and their ratio; returns the size of the measured one, N."""
    now, keep = m.now, s.keep
    size = 0.0
    for k in range(3):
        w = given.wrench[k]
        size += w * w
        two_stages(m.force[k], w, keep)
        two_stages(m.expected[k], now.force[k], keep)
    size = math.sqrt(size)
    two_stages(m.force_size[:], size, keep)
    two_stages(m.lowest[:], now.lowest, keep)
    two_stages(m.highest[:], now.highest, keep)
    product = square = 0.0
    for k in range(3):
        f = e = 0.0
        for j in range(3):
            f += now.frame[3 * k + j] * m.force[j, 1]
            e += now.frame[3 * k + j] * m.expected[j, 1]
        m.results.force[k], m.results.expected[k] = f, e
        product += f * e
        square += e * e
    now.predicted = math.sqrt(square)
    now.ratio = product / square if now.predicted > s.least_force else 0.0
    m.results.force_size, m.results.ratio = m.force_size[1], now.ratio
    return size


@kernel("void(Memory, Settings, float64, boolean, float64, float64)", **MONITOR_TYPES)
def _missing_cut(m: Record, s: Record, least: float, planned: bool, quiet: float, moved: float) -> None:
    """No force over a length of path where the plan's least force, less the model's error, lies above the noise."""
    visible = planned and least * (1.0 - s.model_error) > 2.0 * quiet
    m.results.least = quiet if visible else 0.0
    if visible:
        m.without_force = m.without_force + moved if m.force_size[1] < quiet else 0.0
    judge(m, s, _MISSING, m.without_force, s.missing_length if visible else 0.0, 1)


@kernel("void(Memory, Settings, Given, float64, float64, boolean)", **MONITOR_TYPES)
def _overload(m: Record, s: Record, given: Record, size: float, ceiling: float, planned: bool) -> None:
    """Filtered force above what the plan explains, or force or moment of the cycle above what is allowed."""
    moment = 0.0
    for k in range(3):
        moment += given.wrench[3 + k] ** 2
    moment = math.sqrt(moment)
    value, limit = m.results.force_size, ceiling if planned else 0.0
    top = max(size / s.force_limit, moment / s.moment_limit)
    if top > 1.0 or (not planned and top > 0.0):  # the tighter of both bounds is shown
        value, limit = top * s.force_limit, s.force_limit
        if not math.isfinite(limit):
            value, limit = top * s.moment_limit, s.moment_limit
    judge(m, s, _OVERLOAD, value, limit, s.overload_cycles)


@kernel("void(Memory, Settings, Given, PlanRow, PlanRow, float64, float64, boolean)", **MONITOR_TYPES)
def _detect(
    m: Record, s: Record, given: Record, here: Record, there: Record, size: float, moved: float, planned: bool
) -> None:
    """All detectors on the forces of this cycle, against what no cut needs and what no cut explains."""
    filtered, least, most = m.force_size[1], m.lowest[1], m.highest[1]
    quiet, rest = quiet_force(m, s), noise(m, s)
    ceiling = most * (1.0 + s.model_error) + quiet + s.margin
    idle = planned and most < AIR_N and m.now.highest < AIR_N
    if idle and filtered < ceiling:
        learn_quiet(m, s, filtered)
    m.results.most = ceiling if planned else 0.0
    _missing_cut(m, s, least, planned, quiet, moved)
    _overload(m, s, given, size, ceiling, planned)
    cutting = planned and least > s.least_force
    if cutting:
        m.wear.cut += moved
    m.results.cut = m.wear.cut
    steady = planned and here.steady > 0.5 and there.steady > 0.5 and m.now.predicted > s.least_force
    steady = steady and 0.8 < m.rate < 1.2
    if planned and int(here.tool) != m.tool:
        m.tool = int(here.tool)
        m.known_cycles = 0
        new_tool(m.wear)
        m.events &= ~(1 << _WEAR)
    wear(m, s, moved if cutting else 0.0)
    samples = max(1, round(s.period / s.sample_period))
    turn, teeth = here.turn_per_s * s.sample_period, int(here.teeth)
    estimate_folded(m.samples, m.fast, turn, teeth, samples, s.sample_period)
    breakage(m, s, given, here, rest, steady)
    chatter(m, s, max(most, filtered), idle)
    low_chatter(m, s, given, rest, steady)


@kernel("void(Memory, Settings, Result)", **MONITOR_TYPES)
def _react(m: Record, s: Record, result: Record) -> None:
    """Ask for what the events of the cycle are to do, if the loop is armed; until a person resets."""
    before = result.state
    for event in range(EVENTS):
        if m.outcome.new & (1 << event) and _ARMED <= before < _FAULT:
            if s.reaction[event] == 1 and m.hold_cause == 0:
                m.hold_cause = _FIRST_CAUSE + event
            elif s.reaction[event] == 2 and m.stop_cause == 0:
                m.stop_cause = _FIRST_CAUSE + event
    if m.hold_cause != 0:
        result.feed_hold = 1
    m.outcome.on = m.events


@kernel("void(Memory)", **MONITOR_TYPES)
def _reset_events(m: Record) -> None:
    """A person has reset: no event, nothing asked for, sums of missing force and wear zero."""
    m.events = m.hold_cause = m.stop_cause = m.steady_cycles = 0
    m.lasted[:] = 0
    m.wear.cusum = m.without_force = 0.0


@kernel(
    "void(Given, Result, float64[::1], Plan[::1], PlanRow[::1], Settings[::1], Memory[::1])",
    entry=True,
    **MONITOR_TYPES,
)
def watch(
    given: Record, result: Record, place: Float, path: Records, plan: Records, settings: Records, memories: Records
) -> None:
    """One cycle; see the module and :class:`counterflex.runtime.monitoring.monitor.Monitor`, which owns the records.

    Args:
        given: GIVEN of the step.
        result: RESULT of the step; a feed hold that is asked for is written.
        place: (2,) on the plan, row and fraction.
        path: (n,) PLAN the plan as the step has it.
        plan: (n,) PLAN_ROW of :func:`counterflex.runtime.monitoring.plan.monitor_plan`.
        settings: (1,) SETTINGS.
        memories: (1,) MEMORY; changed.
    """
    s, m = settings[0], memories[0]
    m.outcome.new = m.outcome.seen = 0
    if given.reset == 1:
        _reset_events(m)
    goes_on, read = _goes_on(given), _is_read(given, s)
    if not read:
        m.results.ratio = 0.0  # nothing is known of it: no former one stands for it
    planned = s.planned == 1 and place[0] >= 0.0 and result.path_distance <= s.off_path
    row = max(0, int(place[0])) if s.planned == 1 else 0
    here, there, u = plan[row], plan[min(row + 1, plan.shape[0] - 1)], place[1]
    moved = 0.0
    if goes_on:  # the feed is held against the plan whatever the force sensor shows
        moved = _progress(m, s, here, there, u, given.elapsed) if planned else 0.0
        m.results.rate = m.rate
    if goes_on and read:
        feed = path[row].direction[:]
        feed_frame(
            feed[0], feed[1], feed[2],
            -given.nominal[2], -given.nominal[5], -given.nominal[8], m.directions[:], m.now.frame[:],
        )  # fmt: skip
        _expect(m, s, here, there, u, planned)
        size = _filter_forces(m, s, given)
        follow_motion(m, s, given, result)
        _detect(m, s, given, here, there, size, moved, planned)
    _react(m, s, result)


@kernel("void(Memory, Loop, Given)", **MONITOR_TYPES)
def hand_over(m: Record, settings: Record, given: Record) -> None:
    """Hand what was found before to the supervisor: causes of hold and fault, where there are no others.

    ``m``: MEMORY as :func:`watch` left it.
    """
    given.soft = next_cause(settings, given.soft, m.hold_cause)
    if m.stop_cause != 0 and given.hard == 0:
        given.hard = m.stop_cause
