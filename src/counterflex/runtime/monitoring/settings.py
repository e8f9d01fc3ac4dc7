"""Settings of process monitoring, and the thresholds that follow from stated rates of false alarms."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from statistics import NormalDist
from typing import Final

from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError
from counterflex.core.records import Records, records
from counterflex.core.units import MINUTE, MM, MS
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.records import SETTINGS
from counterflex.runtime.settings import OnlineSettings

CUSUM_SLACK: Final = 0.5
"""Reference value of the cumulative sum: half of the shift, one standard deviation, that it is made for."""
FAST_S: Final = 20.0 * MS
"""Memory of the energy of the fast residual."""
_HOUR: Final = 60.0 * MINUTE
_SIEGMUND: Final = 1.166


class Reaction(IntEnum):
    """Reaction to an event."""

    WARN = 0
    """It is reported."""
    FEED_HOLD = 1
    """The correction holds and the robot program is asked to hold the feed, until a person resets."""
    STOP = 2
    """A fault: the robot is told to stop."""


def _reactions() -> dict[Event, Reaction]:
    feed_hold = (Event.OVERLOAD, Event.BREAKAGE)
    return {event: Reaction.FEED_HOLD if event in feed_hold else Reaction.WARN for event in Event}


@dataclass(frozen=True)
class MonitorSettings:
    """Settings of the process monitor."""

    reaction: dict[Event, Reaction] = field(default_factory=_reactions)  # by event
    # force that spindle and tool may take in the mean over a cycle; None is not watched
    force_limit_n: float | None = None
    moment_limit_nm: float | None = None  # likewise the moment about the tool tip
    margin_n: float = 40.0  # force that is never an overload: inertia of the spindle in corners and the like
    false_alarms_per_h: float = 0.01  # by noise, of each event
    model_sigma: float = 0.10  # relative standard deviation of the predicted force; from identification
    model_probability: float = 1e-3  # that the model is further off than what is not alarmed; over jobs, not cycles
    noise_n: float = 2.0  # noise of the filtered force at rest, at least; more is learnt out of the cut
    fast_noise_n: float = 1.0  # noise of a sample of the sensor, per axis, at least
    filter_s: float = 16.0 * MS  # time constant of each of the two stages of the force filter
    timing_s: float = 60.0 * MS  # how far plan and force may be apart in time
    place_m: float = 0.5 * MM  # how far apart on the path (stock, part zero)
    missing_m: float = 2.0 * MM  # cut without force before it counts as missing
    overload_s: float = 8.0 * MS  # how long an overload lasts before it counts
    breakage_s: float = 24.0 * MS  # likewise a drop
    chatter_s: float = 60.0 * MS  # likewise chatter
    chatter_share: float = 0.1  # broad-band vibration that belongs to a quiet cut, by mean force
    # how long slow vibration goes on in a steady cut before it counts: longer than the arm rings
    low_chatter_s: float = 0.6
    low_chatter_share: float = 0.1  # slow vibration that belongs to a quiet cut, by mean force
    settle_s: float = 0.4  # steady cut before a drop can be seen
    wear_bin_m: float = 20.0 * MM  # length of cut that gives one ratio
    wear_false_alarm_m: float = 1000.0  # length of cut per false alarm of the wear trend
    wear_rise: float = 0.1  # least rise of the ratio that counts
    wear_probability: float = 1e-3  # that a trend is seen where there is none, one look
    inertia_kg: float = 0.0  # mass behind the force sensor whose inertia it feels; 0 where it is taken out before
    clear_s: float = 0.5  # how long a condition is gone before it may be reported again
    stale_cycles: int = 3  # age of a force that is not judged any more
    follow_s: float = 0.0  # how late the robot follows its program
    exponent: float = 0.75  # of the force in the feed per tooth: F ~ f_z ** exponent
    period_s: float = 4.0 * MS  # cycle
    sample_s: float = 1.0 * MS  # period of the force sensor

    def __post_init__(self) -> None:
        """Check ranges. Raises InputError: a number is out of range, or a reaction is missing."""
        above = "margin_n false_alarms_per_h model_sigma noise_n fast_noise_n filter_s missing_m overload_s breakage_s"
        above += " chatter_s chatter_share low_chatter_s low_chatter_share settle_s wear_bin_m wear_false_alarm_m"
        above += " wear_rise clear_s exponent period_s"
        for name in (above + " sample_s").split():
            as_positive(f"monitor: {name}", getattr(self, name))
        for name in ("timing_s", "place_m", "follow_s", "inertia_kg"):
            as_positive(f"monitor: {name}", getattr(self, name), zero=True)
        for name in ("force_limit_n", "moment_limit_nm"):
            if getattr(self, name) is not None:
                as_positive(f"monitor: {name}", getattr(self, name))
        if not 1e-9 <= self.model_probability < 0.5:
            raise InputError("monitor: model_probability is out of range", value=self.model_probability, limit="< 0.5")
        if not 1e-9 <= self.wear_probability < 0.5:
            raise InputError("monitor: wear_probability is out of range", value=self.wear_probability, limit="< 0.5")
        if self.exponent > 1.0:
            raise InputError("monitor: the force grows faster than the feed", value=self.exponent, limit="<= 1")
        if set(self.reaction) != set(Event):
            raise InputError("monitor: a reaction is missing", value=sorted(e.name for e in self.reaction))
        if self.stale_cycles < 1:
            raise InputError("monitor: cycles without data", value=self.stale_cycles, limit=">= 1")
        if self.look_probability >= 0.5:
            raise InputError("monitor: so many false alarms are no threshold", value=self.false_alarms_per_h)

    @property
    def look_probability(self) -> float:
        """False alarm probability of one independent look at the filtered force: the rate times twice the filter."""
        return self.false_alarms_per_h * 2.0 * self.filter_s / _HOUR

    @property
    def z(self) -> float:
        """Standard deviations of noise that :attr:`look_probability` leaves outside, one-sided."""
        return NormalDist().inv_cdf(1.0 - self.look_probability)

    @property
    def model_error(self) -> float:
        """Relative error of the model that :attr:`model_probability` leaves outside, one-sided."""
        return NormalDist().inv_cdf(1.0 - self.model_probability) * self.model_sigma

    @property
    def keep(self) -> float:
        """Share that a stage of the filter keeps per cycle: ``exp(-T / tau)``."""
        return math.exp(-self.period_s / self.filter_s)

    @property
    def cusum(self) -> float:
        """Decision interval of the cumulative sum for one false alarm in :attr:`wear_false_alarm_m`."""
        return decision_interval(self.wear_false_alarm_m / self.wear_bin_m)

    @property
    def energy_quantile(self) -> float:
        """Energy of the fast residual by its mean that noise alone exceeds at the stated rate.

        Chi-squared with ``nu = 3 (2 tau / T_s)`` degrees of freedom by Wilson and Hilferty:
        ``(1 - 2 / (9 nu) + z sqrt(2 / (9 nu)))^3``; one look per memory ``2 tau``.
        """
        nu = 3.0 * 2.0 * FAST_S / self.sample_s
        z = NormalDist().inv_cdf(1.0 - self.false_alarms_per_h * 2.0 * FAST_S / _HOUR)
        return float((1.0 - 2.0 / (9.0 * nu) + z * math.sqrt(2.0 / (9.0 * nu))) ** 3)

    def record(self, off_path_m: float, planned: bool) -> Records:
        """(1,) SETTINGS for the kernels; the program's speed is left alone.

        Args:
            off_path_m: Distance from the plan at which it is not believed.
            planned: There is a plan.
        """
        out = records(SETTINGS)
        s = out[0]
        s.period, s.keep, s.exponent, s.off_path = self.period_s, self.keep, self.exponent, off_path_m
        s.noise, s.fast_noise, s.noise_z = self.noise_n, math.sqrt(3.0) * self.fast_noise_n, self.z
        s.model_error, s.margin, s.least_force = self.model_error, self.margin_n, max(20.0, 4.0 * self.noise_n)
        s.force_limit = math.inf if self.force_limit_n is None else self.force_limit_n
        s.moment_limit = math.inf if self.moment_limit_nm is None else self.moment_limit_nm
        s.missing_length, s.inertia_mass = self.missing_m, self.inertia_kg
        s.bin_length, s.cusum_interval, s.least_rise = self.wear_bin_m, self.cusum, self.wear_rise
        s.trend_z = NormalDist().inv_cdf(1.0 - self.wear_probability)
        s.chatter_share, s.energy_quantile = self.chatter_share, self.energy_quantile
        s.low_chatter_share = self.low_chatter_share
        s.planned = planned
        for event, reaction in self.reaction.items():
            s.reaction[event] = reaction
        s.overload_cycles, s.breakage_cycles = self._cycles(self.overload_s), self._cycles(self.breakage_s)
        s.chatter_cycles, s.low_chatter_cycles = self._cycles(self.chatter_s), self._cycles(self.low_chatter_s)
        s.settle_cycles, s.clear_cycles = self._cycles(self.settle_s), self._cycles(self.clear_s)
        s.stale_cycles = self.stale_cycles
        s.least_speed = 1.0
        s.sample_period, s.energy_time, s.filter_time = self.sample_s, FAST_S, self.filter_s
        return out

    def _cycles(self, time_s: float) -> int:
        return max(1, round(time_s / self.period_s))


def run_length(interval: float, shift: float = 0.0) -> float:
    """Mean number of standard normal values until a one-sided cumulative sum alarms.

    ``(exp(-2 d b) + 2 d b - 1) / (2 d^2)``, ``d = shift - k``, ``b = interval + 1.166``, with k :data:`CUSUM_SLACK`.

    Args:
        interval: Decision interval, standard deviations.
        shift: Of the mean, standard deviations; 0 gives the run length to a false alarm.

    Source: Siegmund 1985, as in Montgomery, Statistical Quality Control, section 9.1.
    """
    d, b = shift - CUSUM_SLACK, interval + _SIEGMUND
    if abs(d) < 1e-9:
        return b * b
    return (math.exp(-2.0 * d * b) + 2.0 * d * b - 1.0) / (2.0 * d * d)


def decision_interval(length: float) -> float:
    """Decision interval whose :func:`run_length` without a shift is ``length`` values; by bisection.

    Raises:
        InputError: Shorter than any interval gives.
    """
    low, high = 0.0, 60.0
    if not run_length(low) < length < run_length(high):
        raise InputError(
            "the length between false alarms is out of range", value=length, limit=f"> {run_length(0.0):g}"
        )
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if run_length(middle) < length else (low, middle)
    return 0.5 * (low + high)


def unwatched(
    online: OnlineSettings, exponent: float = 0.75, inertia_kg: float = 0.0, ring_s: float = 0.0
) -> MonitorSettings:
    """Everything is watched and nothing reacts: what a loop does that was not told.

    Args:
        exponent: Of the force in the feed per tooth.
        inertia_kg: Mass behind the force sensor whose inertia it feels.
        ring_s: Over which a swing of the arm dies away to 1/e.
    """
    return MonitorSettings(
        reaction=dict.fromkeys(Event, Reaction.WARN),
        period_s=online.period_s,
        follow_s=online.delays.follow_s,
        stale_cycles=online.stale_cycles,
        exponent=exponent,
        inertia_kg=inertia_kg,
        low_chatter_s=low_chatter_time(ring_s),
    )


def low_chatter_time(ring_s: float) -> float:
    """Time after which slow vibration is no ring any more: three times its memory, at least 0.6 s.

    A ring that begins A times as large as the limit is above it for ``ring_s log(A)``: for three times ``ring_s`` only
    where A is above 20.

    Args:
        ring_s: Over which a swing of the arm dies away to 1/e, ``1 / (zeta omega)``.
    """
    return max(0.6, 3.0 * ring_s)
