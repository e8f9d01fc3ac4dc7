"""Impairment of datagrams by a network, from a seed: losses, bursts, delays, copies and damage. No socket, no clock.

What happens to datagram n follows from the settings, the seed, the way and n alone: asked again, in any order, the
answer is the same, so that a run can be repeated and two programs can be put under the same faults. Every kind of fault
has random numbers of its own: switching one on changes nothing of the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError

_BLOCK: Final = 512
_LOSS, _BURST, _JITTER, _COPY, _COPY_DELAY, _REORDER, _FLIP, _FLIP_AT, _CUT, _CUT_AT, _GARBAGE = range(11)
_DRAWS: Final = 11


@dataclass(frozen=True)
class Burst:
    """Losses that come together (Gilbert): a good state loses nothing, a bad one everything."""

    # share of all datagrams that is lost in the long run, 0..1; reached while ``share <= mean / (1 + mean)``
    share: float
    mean: float  # mean length of a burst, datagrams

    def __post_init__(self) -> None:
        """Check that such a chain exists. Raises InputError: it does not."""
        if not self.mean >= 1.0:
            raise InputError("mean length of a burst", value=self.mean, limit=">= 1")
        if not 0.0 < self.share < 1.0 or self.into > 1.0:
            raise InputError(
                "share of datagrams lost in bursts",
                value=self.share,
                limit=f"> 0 and <= {self.mean / (1 + self.mean):g}",
            )

    @property
    def out_of(self) -> float:
        """Probability per datagram that a burst ends: ``1 / mean``."""
        return 1.0 / self.mean

    @property
    def into(self) -> float:
        """Probability per datagram that one begins: ``share / (mean (1 - share))``."""
        return self.share / (self.mean * (1.0 - self.share))


@dataclass(frozen=True)
class Stall:
    """A path that stands still: what is sent meanwhile comes at its end, all at once."""

    first: int  # number of the first datagram held back
    count: int  # how many are held back
    lost: bool = False  # they are dropped instead

    def __post_init__(self) -> None:
        """Check the numbers. Raises InputError: one is negative."""
        if self.first < 0 or self.count < 1:
            raise InputError("stall of a network", value=(self.first, self.count), limit="first >= 0, count >= 1")


@dataclass(frozen=True)
class Impairment:
    """Impairment of one way of a network; the default does nothing."""

    loss: float = 0.0  # probability that a datagram is lost, each by itself
    burst: Burst | None = None  # losses in bursts, or None
    pattern: str = ""  # repeated over the datagrams: ``1`` comes, ``0`` is lost; empty: none
    delay_s: float = 0.0  # of every datagram
    jitter_s: float = 0.0  # further delay, uniform from 0 to this
    duplicate: float = 0.0  # probability that a datagram comes twice, the copy up to ``reorder_s`` later
    reorder: float = 0.0  # probability that a datagram comes ``reorder_s`` later than it would
    reorder_s: float = 6e-3
    flip: float = 0.0  # probability that one bit of a datagram is turned over
    truncate: float = 0.0  # probability that its end is missing
    garbage: float = 0.0  # probability that its bytes are replaced by random ones
    stalls: tuple[Stall, ...] = ()  # see Stall
    period_s: float = 4e-3  # time between datagrams, for stalls
    first: int = 0  # datagrams before this one are left alone
    end: int | None = None  # from this one on they are left alone again, or None
    dies: int | None = None  # from this one on all are lost, or None

    def __post_init__(self) -> None:
        """Check ranges. Raises InputError: a number is out of range."""
        for name in ("loss", "duplicate", "reorder", "flip", "truncate", "garbage"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"impairment: {name}", value=getattr(self, name), limit="0..1")
        for name in ("delay_s", "jitter_s", "reorder_s"):
            if not 0.0 <= getattr(self, name) <= 60.0:
                raise InputError(f"impairment: {name}", value=getattr(self, name), limit="0..60 s")
        if not 0.0 < self.period_s <= 60.0:
            raise InputError("impairment: period_s", value=self.period_s, limit="> 0 s")
        if set(self.pattern) - {"0", "1"}:
            raise InputError("impairment: pattern", value=self.pattern, limit="a row of 1 (comes) and 0 (lost)")
        if self.first < 0 or (self.end is not None and self.end < self.first):
            raise InputError("impairment: first and end", value=(self.first, self.end), limit="0 <= first <= end")

    def touches(self, n: int) -> bool:
        """Return whether datagram ``n`` may be changed at all."""
        return n >= self.first and (self.end is None or n < self.end)


@dataclass(frozen=True)
class Delivery:
    """One copy of a datagram that arrives."""

    delay_s: float = 0.0  # after it was sent
    flip: float | None = None  # which bit is turned over, as share 0..1 of its bits; None: none
    keep: float = 1.0  # share of its bytes that is left; 1: all
    garbage: int | None = None  # seed of the random bytes that replace its own; None: they are its own

    @property
    def unchanged(self) -> bool:
        """The bytes are those that were sent."""
        return self.flip is None and self.keep >= 1.0 and self.garbage is None

    def of(self, data: bytes) -> bytes:
        """The bytes that arrive."""
        if self.unchanged or not data:
            return data
        if self.garbage is not None:
            return np.random.default_rng(self.garbage).bytes(len(data))
        out = bytearray(data)
        if self.flip is not None:
            bit = min(int(self.flip * 8 * len(out)), 8 * len(out) - 1)
            out[bit >> 3] ^= 1 << (bit & 7)
        return bytes(out[: int(self.keep * len(out))]) if self.keep < 1.0 else bytes(out)


class Schedule:
    """Fate of each datagram of one way.

    Args:
        seed: Of the random numbers, >= 0.
        way: Number of the way, >= 0: two ways with one seed are independent of each other.

    Raises:
        InputError: ``seed`` or ``way`` below zero.
    """

    def __init__(self, impairment: Impairment, seed: int = 0, way: int = 0) -> None:
        if seed < 0 or way < 0:
            raise InputError("seed of an impairment", value=(seed, way), limit=">= 0")
        self.impairment, self.seed, self.way = impairment, seed, way
        self._draws: dict[int, Float] = {}
        self._bad: list[list[bool]] = []

    def _block(self, number: int) -> Float:
        if number not in self._draws:
            if len(self._draws) > 8:
                self._draws.clear()
            self._draws[number] = np.random.default_rng([self.seed, self.way, number]).random((_BLOCK, _DRAWS))
        return self._draws[number]

    def _in_burst(self, n: int) -> bool:
        burst = self.impairment.burst
        if burst is None:
            return False
        while len(self._bad) <= n // _BLOCK:
            number = len(self._bad)
            bad = self._bad[-1][-1] if self._bad else False
            states = []
            for draw in self._block(number)[:, _BURST].tolist():
                bad = draw >= burst.out_of if bad else draw < burst.into
                states.append(bad)
            self._bad.append(states)
        return self._bad[n // _BLOCK][n % _BLOCK]

    def decide(self, n: int) -> tuple[Delivery, ...]:
        """Deliveries of datagram n, counted from 0 on this way: none, one or two. Raises InputError: n is negative."""
        if n < 0:
            raise InputError("number of a datagram", value=n, limit=">= 0")
        made = self.impairment
        if made.dies is not None and n >= made.dies:
            return ()
        if not made.touches(n):
            return (Delivery(),)
        draw = self._block(n // _BLOCK)[n % _BLOCK]
        stalls = [stall for stall in made.stalls if stall.first <= n < stall.first + stall.count]
        if self._is_lost(n, draw, stalls):
            return ()
        delay = made.delay_s + made.jitter_s * float(draw[_JITTER])
        if draw[_REORDER] < made.reorder:
            delay += made.reorder_s
        for stall in stalls:
            delay += (stall.first + stall.count - n) * made.period_s
        one = Delivery(
            delay,
            float(draw[_FLIP_AT]) if draw[_FLIP] < made.flip else None,
            float(draw[_CUT_AT]) if draw[_CUT] < made.truncate else 1.0,
            int(draw[_GARBAGE] * 2**53) if draw[_GARBAGE] < made.garbage else None,
        )
        if draw[_COPY] < made.duplicate:
            return (one, Delivery(delay + made.reorder_s * float(draw[_COPY_DELAY])))
        return (one,)

    def _is_lost(self, n: int, draw: Float, stalls: list[Stall]) -> bool:
        made, pattern = self.impairment, self.impairment.pattern or "1"
        by_chance = draw[_LOSS] < made.loss or self._in_burst(n)
        return by_chance or pattern[(n - made.first) % len(pattern)] == "0" or any(stall.lost for stall in stalls)
