"""Timing of a machine for the online loop: percentiles of its samples, and a judgement with reasons. Pure.

An answer is in time when it leaves within the cycle in which its telegram came. Of the cycle a quarter is left to
network cards, cables and the controller; the rest must do for waking up, the step, and sending.

Percentiles of any number of times take constant memory: times are counted in classes that are one percent wide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MS

_WIDTH: Final = math.log(1.01)
_LEAST: Final = 1e-2
_CLASSES: Final = 2084  # Up to 1e7 times the unit of the least class


class LatencyHistogram:
    """Counts of times; a percentile is the upper end of its class: at most one percent above a value that was met.

    Valid from 0.01 to 1e7 of the unit that the times are given in; smaller ones count as 0.01, larger ones are in the
    last class, and :attr:`largest` keeps what was met.

    Attributes:
        n: Times counted.
        largest: Of them, 0 for none.
    """

    def __init__(self) -> None:
        self._counts: Int = np.zeros(_CLASSES, dtype=np.int64)
        self.n = 0
        self.largest = 0.0

    def add(self, times: Float) -> None:
        """Count times (n,), finite. Raises InputError: one is not a number or below zero."""
        if len(times) == 0:
            return
        if not np.all(np.isfinite(times)) or np.min(times) < 0.0:
            raise InputError("a time to be counted", value=float(np.min(times)), limit="finite, >= 0")
        classes = np.ceil(np.log(np.maximum(times, _LEAST) / _LEAST) / _WIDTH).astype(np.int64)
        self._counts += np.bincount(np.minimum(classes, _CLASSES - 1), minlength=_CLASSES)
        self.n += len(times)
        self.largest = max(self.largest, float(np.max(times)))

    def plain(self) -> dict[str, Any]:
        """Plain values: ``{"largest": ..., "classes": {number: count}}``."""
        met = np.flatnonzero(self._counts)
        return {"largest": self.largest, "classes": {str(k): int(self._counts[k]) for k in met}}

    def join(self, table: Mapping[str, Any]) -> None:
        """Add the counts of another one.

        Args:
            table: As :meth:`plain` gives it.

        Raises:
            InputError: A class that there is not.
        """
        for name, count in table["classes"].items():
            if not 0 <= int(name) < _CLASSES:
                raise InputError("class of times", value=name, limit=(0, _CLASSES - 1))
            self._counts[int(name)] += int(count)
            self.n += int(count)
        self.largest = max(self.largest, float(table["largest"]))

    def percentiles(self, unit_s: float) -> Percentiles:
        """Percentiles of all times, s; see :meth:`at`.

        Args:
            unit_s: Unit of the times that were counted.
        """
        p50, p99, p999 = (self.at(share) * unit_s for share in (0.5, 0.99, 0.999))
        return Percentiles(p50, p99, p999, self.largest * unit_s, self.n)

    def at(self, share: float) -> float:
        """Time that at least this share (0 .. 1) of all does not exceed, see the class; 0 for none.

        Raises:
            InputError: ``share`` out of range.
        """
        if not 0.0 < share <= 1.0:
            raise InputError("share of a percentile", value=share, limit="0 .. 1")
        if self.n == 0:
            return 0.0
        place = int(np.searchsorted(np.cumsum(self._counts), math.ceil(share * self.n - 1e-9)))
        return min(self.largest, _LEAST * math.exp(place * _WIDTH))


SHARE: Final = 0.75
"""Of the cycle that an answer may take on this machine."""
ENOUGH_CYCLES: Final = 1000
"""Fewer say nothing about 99.9 %."""
_SLOW_SYNC_S: Final = 0.5
_STEAL: Final = 0.01
_STEP: Final = 0.25


class TimingVerdict(StrEnum):
    """Judgement of the timing of a machine."""

    FITS = "fits"
    """It keeps time."""
    TIGHT = "tight"
    """It keeps time, with something to be put right."""
    UNFIT = "does not fit"
    """99.9 % of the answers are not in time: nothing is armed on it."""


@dataclass(frozen=True)
class Percentiles:
    """Percentiles of times; each is a value that was met, never an interpolated one."""

    p50_s: float  # median
    p99_s: float  # 99 %
    p999_s: float  # 99.9 %; of fewer than a thousand values the largest
    max_s: float  # largest
    n: int  # values

    @classmethod
    def of(cls, time_s: Float) -> Percentiles:
        """Percentiles of times: the smallest value met that at least the share of all values does not exceed.

        Args:
            time_s: (n,) s; not-a-number counts as infinite (an answer that never came).

        Raises:
            InputError: No value, or another shape.
        """
        values = np.array(time_s, dtype=np.float64)
        if values.ndim != 1 or len(values) == 0:
            raise InputError("times to judge", value=values.shape, limit="(n,), n >= 1")
        values = np.sort(np.where(np.isnan(values), np.inf, values))
        n = len(values)
        at = [min(n, max(1, math.ceil(fraction * n - 1e-9))) - 1 for fraction in (0.5, 0.99, 0.999)]
        p50, p99, p999 = values[at].tolist()
        return cls(p50, p99, p999, float(values[-1]), n)


@dataclass(frozen=True, eq=False)
class LoopSamples:
    """Measured times of a machine."""

    period_s: float  # cycle of the loop
    late_s: Float  # (n,) how late the loop woke up
    compute_s: Float  # (n,) time of its step
    echo_s: Float  # (n,) until a datagram sent to another process was back; not-a-number where it never came
    write_s: Float  # (k,) until a piece of log was written, without reaching the disk
    sync_s: Float  # (k,) until it had reached the disk
    fifo: bool = True  # real-time priority was granted
    locked: bool = True  # memory could be locked
    cores: int = 4  # that may be used
    governor: str = "performance"  # of the processor's clock; empty where not known
    clock_source: str = "tsc"  # of the kernel; empty where not known
    steal: float = 0.0  # share 0..1 of time that the host of a virtual machine took away
    ring_fits: bool = True  # there is shared memory for the records

    @property
    def reply_s(self) -> Float:
        """(n,) late, step and echo together: longer than an answer takes, since the echo crosses both ways."""
        out: Float = self.late_s + self.compute_s + self.echo_s
        return out


@dataclass(frozen=True)
class Judgement:
    """A verdict and why."""

    verdict: TimingVerdict  # see Verdict
    reply: Percentiles  # percentiles of the whole reply
    budget_s: float  # what it may take
    in_time: float  # share 0..1 of cycles within it
    reasons: tuple[str, ...]  # what speaks against the machine, most important first, each with what to do


def judge(samples: LoopSamples) -> Judgement:
    """Judge a machine: unfit where the 99.9 % of the reply is above three quarters of the cycle, or cannot be known.

    Raises:
        InputError: Times that are not finite (other than the echo's), series of different lengths, no samples.
    """
    period = as_positive("period_s", samples.period_s)
    n = len(samples.late_s)
    late, compute = (as_float(name, getattr(samples, name), (n,)) for name in ("late_s", "compute_s"))
    if samples.echo_s.shape != (n,):
        raise InputError("echo_s has the wrong shape", value=samples.echo_s.shape, limit=(n,))
    reply = Percentiles.of(samples.reply_s)
    budget = SHARE * period
    in_time = float(np.mean(np.nan_to_num(samples.reply_s, nan=np.inf) <= budget))
    unfit: list[str] = []
    if n < ENOUGH_CYCLES:
        unfit.append(f"{n} cycles are too few for 99.9 %: measure for {ENOUGH_CYCLES * period:g} s or longer")
    if reply.p999_s > budget:
        unfit.append(
            f"99.9 % of the replies take up to {_ms(reply.p999_s)}, limit {_ms(budget)} in a cycle of"
            f" {_ms(period)}: {_slowest(late, compute, samples.echo_s)}"
        )
    if not samples.ring_fits:
        unfit.append("no shared memory for the records: make room in /dev/shm")
    tight = _weaknesses(samples, compute, period)
    if reply.max_s > budget and not unfit:
        tight.append(f"the slowest reply took {_ms(reply.max_s)}: end other programs, measure again for longer")
    verdict = TimingVerdict.UNFIT if unfit else TimingVerdict.TIGHT if tight else TimingVerdict.FITS
    return Judgement(verdict, reply, budget, in_time, (*unfit, *tight))


def _weaknesses(samples: LoopSamples, compute: Float, period: float) -> list[str]:
    results = []
    if not samples.fifo:
        results.append(
            "no real-time priority, other programs come first: allow it (ulimit -r 80, or rtprio in limits.conf)"
        )
    if not samples.locked:
        results.append("memory cannot be locked, it may be swapped out: allow it (ulimit -l unlimited)")
    if samples.cores < 2:
        results.append("one core for loop and recorder: use a machine with two or more")
    if samples.governor not in ("", "performance"):
        results.append(f"the processor's clock is lowered when idle ({samples.governor}): set the governor performance")
    if samples.clock_source not in ("", "tsc", "kvm-clock", "arch_sys_counter"):
        results.append(f"the clock {samples.clock_source} is slow to read: see the kernel's clocksource setting")
    if samples.steal > _STEAL:
        results.append(f"the host used {samples.steal:.1%} of the time: run on a machine of its own")
    if Percentiles.of(compute).p99_s > _STEP * period:
        results.append(
            f"the step takes up to {_ms(Percentiles.of(compute).p99_s)} of {_ms(period)}: a faster processor"
        )
    if len(samples.sync_s) and Percentiles.of(samples.sync_s).p99_s > _SLOW_SYNC_S:
        results.append(
            f"the disk of the log takes up to {_ms(Percentiles.of(samples.sync_s).p99_s)}:"
            " a power failure loses that much of the log; write it to a faster disk"
        )
    return results


def _slowest(late: Float, compute: Float, echo: Float) -> str:
    """Slowest part of the reply, and the remedy."""
    parts = {
        "wake-up latency (take other load off the machine, allow real-time priority, switch power saving off)": late,
        "the step itself (a faster processor, or its clock is lowered)": compute,
        "the network stack or the other process (take other load off the machine)": echo,
    }
    return "most of it " + max(parts, key=lambda name: Percentiles.of(parts[name]).p999_s)


def _ms(time_s: float) -> str:
    return "more than a cycle" if math.isinf(time_s) else f"{time_s / MS:.3g} ms"
