"""Detectors of process monitoring with a memory of their own (wear, breakage, chatter), and how an event is made."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.monitoring.air_noise import IDLE_LEARNT, IDLE_S
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.fast_force import NOTCH_S
from counterflex.runtime.monitoring.records import MEMORY, PLAN_ROW, SETTINGS
from counterflex.runtime.monitoring.wear import add_ratio, force_class, normal_of_student, trend
from counterflex.runtime.state.given import GIVEN

PEAK_S: Final = 0.15
"""How long a force counts for the vibration that comes from it."""
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
RISE_OF_TOOTH: Final = 0.25
"""Rise between the tooth passing by the tooth passing: one tooth lost leaves from 0.4 (two and six teeth 0.8, 0.45)."""
RISE_OF_TURN: Final = 0.5
"""And by what run-out leaves there: it rises by a fifth in a narrower cut, and beats at speeds where lines meet."""
SHARE_OF_LOST: Final = 0.4
"""Least drop by the share that is lost with one tooth, where the rise says that one is."""
ALL_LOST: Final = 0.7
"""Drop that is a breakage without a rise: no force is left between the tooth passing either."""
HALF_LOST: Final = 0.5
"""Drop that is a breakage where tooth passing and the lines between it cannot be told apart: stock may be as thin."""
_SLOW_S: Final = 1.0
_DOUBT: Final = 250  # cycles after which a lower ratio that was no event becomes the new reference
_WEAR, _BREAKAGE, _CHATTER = int(Event.WEAR), int(Event.BREAKAGE), int(Event.CHATTER)
_LOW_CHATTER = int(Event.LOW_CHATTER)
_LATCHED = (1 << _BREAKAGE) | (1 << _WEAR)


@kernel("void(Memory, Settings, int64, float64, float64, int64)", Memory=MEMORY, Settings=SETTINGS)
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


@kernel("void(Memory, Settings, float64)", Memory=MEMORY, Settings=SETTINGS)
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


@kernel("void(Memory, Settings, PlanRow, float64, boolean)", Memory=MEMORY, Settings=SETTINGS, PlanRow=PLAN_ROW)
def breakage(m: Record, s: Record, here: Record, noise: float, steady: bool) -> None:
    """A drop of the ratio against its own past in a steady stretch, weighed by what happens between the tooth passing.

    Thinner stock takes all lines of the spindle down with the force; a lost tooth raises those between the tooth
    passing. Where they are told apart, a drop without such a rise is stock, unless hardly any force is left.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        here: Row of the plan.
        noise: Of the filtered force.
        steady: The plan is.
    """
    fast, past, ratio, predicted = m.fast, m.reference, m.now.ratio, m.now.predicted
    if not steady:
        m.steady_cycles = 0
        m.risen = 0.0
        judge(m, s, _BREAKAGE, 0.0, 0.0, s.breakage_cycles)
        return
    turn, tooth = fast.turn / predicted, fast.tooth / predicted
    m.steady_cycles += 1
    n = m.steady_cycles
    if n == 1:
        past.ratio, past.turn, past.tooth = ratio, turn, tooth
        past.ratio_variance = past.turn_variance = 0.0
    # Harmonics that fold into the mean force shake the ratio, whether they beat at present or not.
    floor = math.hypot(noise, SHAKEN * m.samples.slow) / predicted
    spread = math.sqrt(past.ratio_variance + floor * floor)
    turn_spread = math.sqrt(past.turn_variance + (s.fast_noise * 0.3 / predicted) ** 2)
    reference = past.ratio
    drop = limit = rise = needed = 0.0
    lost = here.lost_tooth if here.teeth > 0.0 else 0.25
    if n > s.settle_cycles and reference > 0.1:
        drop = 1.0 - ratio / reference
        scatter = s.noise_z * spread / reference
        separate = fast.ready > 0.5 and fast.separate > 0.5
        needed = max(s.noise_z * turn_spread, RISE_OF_TOOTH * past.tooth, RISE_OF_TURN * past.turn)
        if separate:
            rise = turn - past.turn * max(0.0, 1.0 - drop)
            limit = max(SHARE_OF_LOST * lost, spread / reference) if rise > needed else max(ALL_LOST, scatter)
        else:
            limit = max(HALF_LOST, scatter)
    m.risen = max(0.0, rise) * predicted
    judge(m, s, _BREAKAGE, drop, limit, s.breakage_cycles)
    suspicious = limit > 0.0 and (rise > 0.5 * needed > 0.0 or drop > max(0.4 * lost, 0.5 * s.noise_z * spread))
    m.doubtful_cycles = m.doubtful_cycles + 1 if suspicious else 0
    if not suspicious or m.doubtful_cycles > _DOUBT:
        share = max(s.period / _SLOW_S, 1.0 / n)
        past.ratio_variance += share * ((ratio - reference) ** 2 - past.ratio_variance)
        past.turn_variance += share * ((turn - past.turn) ** 2 - past.turn_variance)
        past.ratio += share * (ratio - reference)
        past.turn += share * (turn - past.turn)
        past.tooth += share * (tooth - past.tooth)


@kernel("void(Memory, Settings, float64, boolean)", Memory=MEMORY, Settings=SETTINGS)
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


@kernel("void(Memory, Settings, Given, float64, boolean)", Memory=MEMORY, Settings=SETTINGS, Given=GIVEN)
def low_chatter(m: Record, s: Record, given: Record, noise: float, steady: bool) -> None:
    """Slow vibration of the force that goes on and on where the plan is steady.

    Measured minus predicted force less its own mean of :data:`LEVEL_S`: what vibrates between 1 Hz and half the rate of
    the telegrams, root mean square over :data:`SLOW_S`. A ring after an entry or a jump of the correction dies away
    with the arm's damping; what stays above the limit for the whole of the stated time does not.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        given: Of the step.
        noise: Of the filtered force.
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
