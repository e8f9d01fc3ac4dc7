"""Detectors of process monitoring with a memory of their own (wear, breakage, chatter), and how an event is made."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.monitoring.air_noise import IDLE_LEARNT, IDLE_S
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.records import MONITOR_TYPES
from counterflex.runtime.monitoring.spindle_lines import NOTCH_S
from counterflex.runtime.monitoring.wear import add_ratio, force_class, normal_of_student, trend

PEAK_S: Final = 0.4
"""How long a force counts for the vibration that comes from it. Behind an exit the notches of neighbouring lines ring
on in each other, longer than one alone: at 15 000 rpm and three teeth, 0.15 s reported that ring as chatter in 2 of 24
sound cuts. With 1 s, chatter that a notch took for a line is not seen behind the cut any more (seeds 1000 to 1029).
"""
LEVEL_S: Final = 0.16
"""Memory of the mean about which a force vibrates slowly: what is below 1 Hz is none."""
SLOW_S: Final = 0.12
"""Memory of the energy of slow vibration."""
ONSET: Final = 1.0
"""Alternating force by mean force, at most, that a change of the force brings with it."""
ALIAS: Final = 1.5
"""Slow force by what is estimated of lines that fold into it: their beats."""
SHAKEN: Final = 0.5
"""Share of harmonics that fold to hardly any frequency that shakes the ratio: the force filter takes the rest."""
HIGHER: Final = 0.4
"""Root mean square of harmonics that are not followed by those that are, of a cut of 15 % of the diameter."""
CHANGE_OF_TOOTH: Final = 0.25
"""Change of the pattern by the tooth passing: one tooth lost leaves from 0.4 (two and six teeth 0.8, 0.45)."""
CHANGE_OF_TURN: Final = 0.3
"""Change by what run-out leaves between the tooth passing: more in a narrower cut."""
LEAK: Final = 0.25
"""Change by the change of the force within the time constant of the notches: lines leak into their neighbours."""
SHARE_OF_LOST: Final = 0.4
"""Least drop by the share that is lost with one tooth, where the rise says that one is."""
ALL_LOST: Final = 0.7
"""Drop that is a breakage without a rise: no force is left between the tooth passing either."""
HALF_LOST: Final = 0.5
"""Drop that is a breakage where tooth passing and the lines between it cannot be told apart: stock may be as thin."""
_SLOW_S: Final = 1.0
_SAME: Final = 0.1  # share by which the planned force differs, to be the same cut behind a gap
_DOUBT: Final = 250  # cycles after which a lower ratio that was no event becomes the new reference
_TOGETHER: Final = 75  # cycles after a drop within which a change of the pattern belongs to it
_WITHOUT: Final = 12  # cycles of a changed pattern without a drop after which it is no lost tooth
_WEAR, _BREAKAGE, _CHATTER = int(Event.WEAR), int(Event.BREAKAGE), int(Event.CHATTER)
_LOW_CHATTER = int(Event.LOW_CHATTER)
_LATCHED = (1 << _BREAKAGE) | (1 << _WEAR)


@kernel("void(Memory, Settings, int64, float64, float64, int64)", **MONITOR_TYPES)
def judge(m: Record, s: Record, event: int, value: float, limit: float, cycles: int) -> None:
    """One detector: value above limit for so many cycles in a row is an event; it may come again after a pause.

    Args:
        m: MEMORY; value, limit, counters and bits are changed.
        s: SETTINGS.
        event: Which.
        value: What is watched.
        limit: Not above 0: cannot be seen at present, the counter stands still.
        cycles: In a row.
    """
    bit = 1 << event
    m.results.value[event] = value
    if limit <= 0.0:
        m.results.limit[event] = 0.0
        return
    m.results.limit[event] = limit
    m.outcome.seen |= bit
    if value > limit:
        m.lasted[event] += 1
        m.gone[event] = 0
        if m.lasted[event] >= cycles and not m.events & bit:
            m.events |= bit
            m.outcome.new |= bit
    else:
        m.lasted[event] = 0
        m.gone[event] += 1
        if m.gone[event] >= s.clear_cycles and not bit & _LATCHED:
            m.events &= ~bit


@kernel("void(Memory, Settings, float64)", **MONITOR_TYPES)
def wear(m: Record, s: Record, moved: float) -> None:
    """Collect ratios by length of cut; judge the rise once sum and trend both say that there is one.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        moved: Length of cut since the last cycle, m.
    """
    w, now = m.wear, m.now
    if now.ratio != 0.0 and moved > 0.0 and 0.8 < m.rate < 1.2:
        square = now.predicted**2
        w.bin_product += now.ratio * square * moved
        w.bin_square += square * moved
        w.bin_length += moved
        if w.bin_length >= s.bin_length:
            force = math.sqrt(w.bin_square / w.bin_length)
            add_ratio(w, force_class(force), w.cut - 0.5 * w.bin_length, w.bin_product / w.bin_square)
            w.bin_product = w.bin_square = w.bin_length = 0.0
    r = m.results
    trend(w, w.cut, r)
    seen = r.trend_degrees > 0.0 and w.cusum > s.cusum_interval
    if seen:
        t = r.trend / r.trend_sigma
        seen = normal_of_student(t, r.trend_degrees) > s.trend_z
    judge(m, s, _WEAR, r.rise, s.least_rise if seen else 0.0, 1)
    if not seen:
        r.value[_WEAR] = r.rise


@kernel("float64(Memory, Given, int64)", **MONITOR_TYPES)
def _in_tool(m: Record, given: Record, axis: int) -> float:
    """Filtered predicted force along an axis of the tool, N."""
    total = 0.0
    for j in range(3):
        total += given.nominal[3 * j + axis] * m.expected[j, 1]
    return total


@kernel("float64(Memory, Given)", **MONITOR_TYPES)
def _plan_change(m: Record, given: Record) -> float:
    """Difference of the planned force from that of the cut so far, as a share of it."""
    square = difference = 0.0
    for k in range(3):
        square += m.reference.force[k] ** 2
        difference += (_in_tool(m, given, k) - m.reference.force[k]) ** 2
    return math.sqrt(difference / square) if square > 0.0 else math.inf


@kernel("void(Memory, Settings, Given, float64, boolean)", **MONITOR_TYPES)
def _learn_steady(m: Record, s: Record, given: Record, change: float, sound: bool) -> None:
    """Let the values of the steady cut follow; the change of the pattern only where it is known and sound."""
    past, share = m.reference, max(s.period / _SLOW_S, 1.0 / m.known_cycles)
    if sound:
        past.change_variance += share * ((change - past.change) ** 2 - past.change_variance)
        past.change += share * (change - past.change)
    if m.calm == 1:
        past.ratio_variance += share * ((m.now.ratio - past.ratio) ** 2 - past.ratio_variance)
        past.ratio += share * (m.now.ratio - past.ratio)
        past.turn += share * (m.fast.turn / m.now.predicted - past.turn)
        for k in range(3):
            past.force[k] += share * (_in_tool(m, given, k) - past.force[k])


@kernel("void(Memory, Settings, Given, PlanRow, float64, boolean)", **MONITOR_TYPES)
def breakage(m: Record, s: Record, given: Record, here: Record, noise: float, steady: bool) -> None:
    """A drop of the ratio against the steady cut so far, weighed by the change of the tooth-to-tooth pattern.

    Thinner stock scales the pattern, run-out is a part of it; a lost tooth changes it. Where the lines show the
    pattern, a drop without a change is stock, unless hardly any force is left. Values are kept over gaps of the stock.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        here: Row of the plan.
        steady: The plan is.
    """
    fast, past, ratio, predicted = m.fast, m.reference, m.now.ratio, m.now.predicted
    if not steady:
        m.steady_cycles = m.calm = 0
        m.risen = 0.0
        judge(m, s, _BREAKAGE, 0.0, 0.0, s.breakage_cycles)
        return
    measured = fast.ready > 0.5 and fast.change >= 0.0  # not in older logs
    change = fast.change / predicted if measured else 0.0
    if m.steady_cycles == 0 and _plan_change(m, given) > _SAME:
        m.known_cycles = 0
    m.steady_cycles += 1
    m.known_cycles += 1
    if m.known_cycles == 1:
        past.ratio, past.turn, past.change = ratio, fast.turn / predicted, change
        past.ratio_variance = past.change_variance = 0.0
        for k in range(3):
            past.force[k] = _in_tool(m, given, k)
    # Harmonics that fold into the mean force shake the ratio, whether they beat at present or not.
    floor = math.hypot(noise, SHAKEN * m.samples.slow) / predicted
    spread = math.sqrt(past.ratio_variance + floor * floor)
    change_spread = math.sqrt(past.change_variance + (s.fast_noise * 0.3 / predicted) ** 2)
    reference = past.ratio
    drop = limit = least = needed = 0.0
    lost = here.lost_tooth if here.teeth > 0.0 else 0.25
    if m.known_cycles > s.settle_cycles and reference > 0.1:
        drop = 1.0 - ratio / reference
        scatter = s.noise_z * spread / reference
        least = max(SHARE_OF_LOST * lost, spread / reference)
        needed = max(past.change + s.noise_z * change_spread, CHANGE_OF_TOOTH * fast.tooth / predicted)
        needed = max(needed, (CHANGE_OF_TURN + _plan_change(m, given)) * past.turn) + LEAK * m.onset / predicted
        if measured:
            together = change > needed and m.less_cycles <= _TOGETHER
            limit = least if together else max(ALL_LOST, scatter)
        else:
            limit = max(HALF_LOST, scatter)
    m.less_cycles = m.less_cycles + 1 if drop > least > 0.0 else 0
    m.risen = change * predicted
    judge(m, s, _BREAKAGE, drop, limit, s.breakage_cycles)
    less = limit > 0.0 and drop > max(0.4 * lost, 0.5 * s.noise_z * spread)
    other = limit > 0.0 and change > 0.5 * needed > 0.0
    m.doubtful_cycles = m.doubtful_cycles + 1 if less or other else 0
    m.calm = 0 if (less or other) and m.doubtful_cycles <= _DOUBT else 1
    # Lines that beat in a sound cut do so without a drop; amplitudes beat about their mean, which is kept.
    sound = measured and (not other or (fast.separate > 1.5 and drop < least and m.doubtful_cycles > _WITHOUT))
    _learn_steady(m, s, given, change, sound)


@kernel("void(Memory, Settings, float64, boolean)", **MONITOR_TYPES)
def chatter(m: Record, s: Record, force: float, idle: bool) -> None:
    """Energy that does not turn with the spindle against that out of the cut, a share of the force, what is slower.

    Where the force or a line of the spindle changes, the notches follow with their time constant: what they leave then
    counts as of the cut.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        force: Largest force to be expected.
        idle: Out of the cut.
    """
    fast = m.fast
    ready = fast.ready > 0.5
    energy = fast.residual**2
    slower = fast.slower**2
    floor = s.fast_noise**2
    if ready and idle:
        m.idle_fast_cycles += 1
        share = max(s.period / IDLE_S, 1.0 / m.idle_fast_cycles)
        m.idle_fast += share * (max(0.0, energy - slower) - m.idle_fast)
    if m.idle_fast_cycles >= IDLE_LEARNT:
        floor = max(floor, m.idle_fast)
    change = abs(m.force_size[0] - m.force_size[1]) * NOTCH_S / s.filter_time
    m.onset = max(change, m.onset * math.exp(-s.period / NOTCH_S))
    # The vibration is remembered longer than the force: at an exit it is judged by the force it comes from.
    m.peak = max(force, m.peak * math.exp(-s.period / PEAK_S))
    lines = 0.5 * (fast.turn**2 + fast.tooth**2)
    if not math.isfinite(lines):  # as in older logs
        lines = 0.0
    quiet = floor + (s.chatter_share * m.peak) ** 2 + HIGHER * HIGHER * lines
    limit = math.sqrt(quiet * s.energy_quantile + slower + (ONSET * m.onset) ** 2 + m.risen**2) if ready else 0.0
    judge(m, s, _CHATTER, fast.residual, limit, s.chatter_cycles)


@kernel("void(Memory, Settings, Given, float64, boolean)", **MONITOR_TYPES)
def low_chatter(m: Record, s: Record, given: Record, noise: float, steady: bool) -> None:
    """Slow vibration of the force that goes on and on where the plan is steady.

    Measured minus predicted force less its own mean of :data:`LEVEL_S`: what vibrates between 1 Hz and half the rate of
    the telegrams, root mean square over :data:`SLOW_S`. A ring after an entry or a jump of the correction dies away
    with the arm's damping; what stays above the limit for the whole of the stated time does not.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        steady: The plan is.
    """
    least = s.period / LEVEL_S
    square = 0.0
    for k in range(3):
        residual = given.wrench[k] - m.now.force[k]
        m.level[k] += least * (residual - m.level[k])
        square += (residual - m.level[k]) ** 2
    m.slow += s.period / SLOW_S * (square - m.slow)
    if not steady:
        m.lasted[_LOW_CHATTER] = 0
        m.slow = 0.0
        for k in range(3):
            m.level[k] = given.wrench[k] - m.now.force[k]
    limit = 0.0
    if steady and math.isfinite(m.samples.alias):  # else harmonics of the tooth passing look like slow force
        limit = math.hypot(
            math.hypot(s.low_chatter_share * m.now.predicted, s.noise_z * noise), ALIAS * m.samples.alias
        )
    judge(m, s, _LOW_CHATTER, math.sqrt(m.slow), limit, s.low_chatter_cycles)
