"""Detectors of process monitoring with a memory of their own (wear, breakage, chatter), and how an event is made."""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.monitoring.air_noise import IDLE_LEARNT, IDLE_S
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.fast_force import SLOWER
from counterflex.runtime.monitoring.records import MEMORY, PLAN_ROW, SETTINGS
from counterflex.runtime.monitoring.wear import add_ratio, force_class, normal_of_student, trend
from counterflex.runtime.state.given import GIVEN

PEAK_S: Final = 0.15
"""How long a force counts for the vibration that comes from it."""
LEVEL_S: Final = 0.16
"""Memory of the mean about which a force vibrates slowly: what is below 1 Hz is none."""
SLOW_S: Final = 0.12
"""Memory of the energy of slow vibration."""
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
    """A drop of the ratio against its own past in a steady stretch.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        here: Row of the plan.
        noise: Of the filtered force.
        steady: The plan is.
    """
    fast, past, ratio, predicted = m.fast, m.reference, m.now.ratio, m.now.predicted
    turn = fast.turn / predicted if predicted > 0.0 else 0.0
    if not steady:
        m.steady_cycles = 0
        judge(m, s, _BREAKAGE, 0.0, 0.0, s.breakage_cycles)
        return
    m.steady_cycles += 1
    n = m.steady_cycles
    if n == 1:
        past.ratio, past.turn = ratio, turn
        past.ratio_variance = past.turn_variance = 0.0
    floor = noise / predicted
    spread = math.sqrt(past.ratio_variance + floor * floor)
    turn_spread = math.sqrt(past.turn_variance + (s.fast_noise * 0.3 / predicted) ** 2)
    reference = past.ratio
    drop, limit = 0.0, 0.0
    ready = n > s.settle_cycles and reference > 0.1
    if ready:
        drop = 1.0 - ratio / reference
        scatter = s.noise_z * spread / reference
        tooth = here.lost_tooth if here.teeth > 0.0 else 0.25
        separate = fast.ready > 0.5 and fast.separate > 0.5
        rose = separate and turn > past.turn + s.noise_z * turn_spread
        limit = min(0.5, max(0.5 * tooth if rose else 2.0 * tooth, scatter))
        if limit < scatter:
            limit = 0.0
    judge(m, s, _BREAKAGE, drop, limit, s.breakage_cycles)
    suspicious = limit > 0.0 and drop > 0.4 * here.lost_tooth and drop > 0.5 * s.noise_z * spread / reference
    m.doubtful_cycles = m.doubtful_cycles + 1 if suspicious else 0
    if not suspicious or m.doubtful_cycles > _DOUBT:
        share = max(s.period / _SLOW_S, 1.0 / n)
        past.ratio_variance += share * ((ratio - reference) ** 2 - past.ratio_variance)
        past.turn_variance += share * ((turn - past.turn) ** 2 - past.turn_variance)
        past.ratio += share * (ratio - reference)
        past.turn += share * (turn - past.turn)


@kernel("void(Memory, Settings, float64, boolean)", Memory=MEMORY, Settings=SETTINGS)
def chatter(m: Record, s: Record, force: float, idle: bool) -> None:
    """Energy that does not turn with the spindle against that out of the cut, a share of the force, what is slower.

    Args:
        m: MEMORY; changed.
        s: SETTINGS.
        force: Largest force to be expected.
        idle: Out of the cut.
    """
    fast = m.fast
    ready = fast.ready > 0.5
    energy = fast.residual**2
    slower = (SLOWER * fast.slower) ** 2
    floor = s.fast_noise**2
    if ready and idle:
        m.idle_fast_cycles += 1
        share = max(s.period / IDLE_S, 1.0 / m.idle_fast_cycles)
        m.idle_fast += share * (max(0.0, energy - slower) - m.idle_fast)
    if m.idle_fast_cycles >= IDLE_LEARNT:
        floor = max(floor, m.idle_fast)
    # The vibration is remembered longer than the force: at an exit it is judged by the force it comes from.
    m.peak = max(force, m.peak * math.exp(-s.period / PEAK_S))
    quiet = floor + (s.chatter_share * m.peak) ** 2
    limit = math.sqrt(quiet * s.energy_quantile + slower) if ready else 0.0
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
    limit = math.hypot(s.low_chatter_share * m.now.predicted, s.noise_z * noise) if steady else 0.0
    judge(m, s, _LOW_CHATTER, math.sqrt(m.slow), limit, s.low_chatter_cycles)
