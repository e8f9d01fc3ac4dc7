"""Scripted, seeded faults of a simulated instrument or controller: what happens when, or to which datagram.

A pure schedule: the same seed, the same times and the same datagrams give the same faults, and one fault more or less
changes none of the others. What chance does to a datagram is the matter of
:mod:`counterflex.twin.network.impairment`; here it is said when, and what becomes of the instrument itself. Nothing
here knows a protocol, a clock or a socket; :mod:`counterflex.twin.network.faults` carries datagrams by it.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final, Literal, get_args

from counterflex.core.errors import InputError
from counterflex.twin.network.impairment import Burst, Impairment, Schedule

Direction = Literal["out", "in"]
"""Of datagrams: what the instrument sends, or what it receives."""
DatagramKind = Literal["lost", "bursts", "late", "reordered", "repeated", "garbage", "truncated", "flipped"]
SourceKind = Literal["silent", "dying", "counter", "saturated", "frozen", "status", "nan", "beam_broken", "offset"]
DATAGRAM_KINDS: Final[tuple[str, ...]] = get_args(DatagramKind)
SOURCE_KINDS: Final[tuple[str, ...]] = get_args(SourceKind)
_LONGEST_S: Final = 60.0
_TICK_S: Final = 1e-9  # times of cycles are sums and differences of decimals


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        kind: What happens; to datagrams

            - ``lost``, each by itself, or in ``bursts`` of ``mean`` length,
            - ``repeated`` (it comes twice), ``truncated`` (anywhere), ``flipped`` (one bit),
            - ``late`` by ``late_s``, overtaken by those that follow in the meantime,
            - ``reordered``: it comes after the one that follows it,
            - ``garbage``: bytes of chance in its place, of its own length;

            to the instrument

            - ``silent``: it sends nothing, and goes on afterwards; ``dying``: it never comes back,
            - ``counter``: its counter of datagrams jumps, once, by ``step``,
            - ``saturated``, ``frozen`` (the last value is repeated), ``nan``, ``status`` (``bits`` are set),
            - ``beam_broken``, ``offset``: all readings are off by ``offset`` (a wrong reflector).

        share: Share of the datagrams or samples of its window that it hits, 0 .. 1.
        from_s: Begin of its window, s since the start.
        for_s: Length of its window.
        first: First datagram of its window, from 0; with ``count`` instead of times.
        count: Number of datagrams in its window.
        direction: Of the datagrams.
        late_s: See ``late``.
        mean: See ``bursts``.
        step: See ``counter``.
        bits: See ``status``.
        offset: (3,) m along the instrument's axes, for a force sensor (3,) N, for a strain amplifier the strain first.
        bridge: Of a strain amplifier: the bridge that it hits, from 1; None: all of them.
    """

    kind: DatagramKind | SourceKind
    share: float = 1.0
    from_s: float = 0.0
    for_s: float = math.inf
    first: int = 0
    count: int | None = None
    direction: Direction = "out"
    late_s: float = 0.0
    mean: float = 1.0
    step: int = 0
    bits: int = 0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bridge: int | None = None

    def __post_init__(self) -> None:
        """Check that the numbers belong to the kind.

        Raises:
            InputError: An unknown kind, a number out of range, or one that is missing.
        """
        if self.kind not in (*DATAGRAM_KINDS, *SOURCE_KINDS):
            raise InputError("unknown fault", value=self.kind, limit=", ".join((*DATAGRAM_KINDS, *SOURCE_KINDS)))
        where = f"fault {self.kind}"
        if not 0.0 < self.share <= 1.0:
            raise InputError("share of a fault", where=where, value=self.share, limit="> 0 and <= 1")
        if not (0.0 <= self.from_s < math.inf and self.for_s > 0.0):
            raise InputError("window of a fault", where=where, value=(self.from_s, self.for_s), limit=">= 0 and > 0")
        if self.first < 0 or (self.count is not None and self.count < 1):
            raise InputError("window of a fault", where=where, value=(self.first, self.count), limit=">= 0 and >= 1")
        if self.direction not in get_args(Direction):
            raise InputError("direction of a fault", where=where, value=self.direction, limit="out or in")
        if self.direction == "in" and self.kind not in DATAGRAM_KINDS:
            raise InputError("only datagrams have a direction", where=where, value="in", limit="out")
        wrong, what, value, limit = self._numbers_of_kind()
        if wrong:
            raise InputError(what, where=where, value=value, limit=limit)
        if self.kind in ("silent", "dying", "counter") and self.share != 1.0:
            raise InputError("this fault has no share", where=where, value=self.share, limit="1")
        self.impairment()

    def _numbers_of_kind(self) -> tuple[bool, str, object, str]:
        """Check the number that the kind needs: whether it is wrong, its name, its value, its limit."""
        match self.kind:
            case "late":
                wrong = not 0.0 < self.late_s <= _LONGEST_S
                return wrong, "how late is not said", self.late_s, f"> 0 and <= {_LONGEST_S} s"
            case "counter":
                return self.step == 0, "how far the counter jumps is not said", 0, "not 0"
            case "status":
                return not 0 < self.bits <= 0xFFFFFFFF, "bits of the status", self.bits, "1 .. 0xFFFFFFFF"
            case "offset":
                wrong = not all(map(math.isfinite, self.offset)) or not any(self.offset)
                return wrong, "offset of the readings", self.offset, "finite and not zero"
            case _:
                return False, "", None, ""

    def impairment(self) -> Impairment:
        """The fault as what chance does to datagrams; one that is lost there is one that the fault hits.

        Raises:
            InputError: Bursts that cannot be.
        """
        match self.kind:
            case "bursts":
                return Impairment(burst=Burst(self.share, self.mean))
            case "late":
                return Impairment(reorder=self.share, reorder_s=self.late_s)
            case "reordered":
                return Impairment(reorder=self.share, reorder_s=_LONGEST_S)
            case "repeated":
                return Impairment(duplicate=self.share, reorder_s=0.0)
            case "garbage":
                return Impairment(garbage=self.share)
            case "truncated":
                return Impairment(truncate=self.share)
            case "flipped":
                return Impairment(flip=self.share)
            case _:
                return Impairment(loss=self.share)

    def covers(self, index: int, time_s: float) -> bool:
        """Return whether a datagram or sample lies in the window."""
        if index < self.first or (self.count is not None and index >= self.first + self.count):
            return False
        return -_TICK_S <= time_s - self.from_s < self.for_s - _TICK_S


@dataclass(frozen=True)
class FaultyDelivery:
    """One copy of a datagram that arrives."""

    data: bytes
    late_s: float = 0.0  # after it was sent
    overtaken_by: int = 0  # datagrams that follow it and arrive before it


@dataclass(frozen=True)
class Condition:
    """In what condition an instrument is for one sample."""

    silent: bool = False  # it sends nothing
    dead: bool = False  # it never will again
    saturated: bool = False  # its readings are at the end of their range
    frozen: bool = False  # it repeats its last reading
    not_a_number: bool = False  # its readings are NaN
    beam_broken: bool = False  # a tracker does not see its target
    bits: int = 0  # set in its status
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # (3,) m or N added to its readings
    step: int = 0  # sum of the jumps of its counter so far


SOUND: Final = Condition()
"""Nothing is wrong."""


@dataclass(frozen=True)
class FaultSchedule:
    """All faults of one instrument."""

    faults: tuple[Fault, ...] = ()  # those of datagrams act one after the other, each on what the one before has left
    seed: int = 0  # of chance
    _of_datagrams: dict[str, tuple[tuple[Fault, Schedule], ...]] = field(init=False, repr=False, compare=False)
    _of_source: tuple[tuple[Fault, Schedule], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Sort the faults by what they act on."""
        if self.seed < 0:
            raise InputError("seed of faults", value=self.seed, limit=">= 0")
        drawn = tuple((f, Schedule(f.impairment(), self.seed, n)) for n, f in enumerate(self.faults))
        by_direction = {
            d: tuple((f, chance) for f, chance in drawn if f.kind in DATAGRAM_KINDS and f.direction == d)
            for d in get_args(Direction)
        }
        object.__setattr__(self, "_of_datagrams", by_direction)
        object.__setattr__(self, "_of_source", tuple((f, chance) for f, chance in drawn if f.kind in SOURCE_KINDS))

    def require(self, kinds: Iterable[str], instrument: str, *, bridges: int = 0) -> None:
        """Refuse faults that an instrument cannot show.

        Args:
            kinds: Of the instrument itself that it can.
            bridges: Number of bridges that a fault may hit alone.

        Raises:
            InputError: One of the faults is not among ``kinds``, or hits a bridge that the instrument does not have.
        """
        known = (*DATAGRAM_KINDS, *kinds)
        wrong = next((f.kind for f in self.faults if f.kind not in known), None)
        if wrong is not None:
            raise InputError(f"{instrument} cannot show this fault", value=wrong, limit=", ".join(known))
        alone = next((f.bridge for f in self.faults if f.bridge is not None and not 1 <= f.bridge <= bridges), None)
        if alone is not None:
            limit = f"1..{bridges}" if bridges else "no bridge: a strain amplifier has them"
            raise InputError(f"{instrument} does not have the bridge of this fault", value=alone, limit=limit)

    def spares(self, direction: Direction) -> bool:
        """Return whether every datagram of a direction arrives as it was sent."""
        return not self._of_datagrams[direction]

    def deliveries(self, data: bytes, index: int, time_s: float, direction: Direction = "out") -> list[FaultyDelivery]:
        """Deliveries of a datagram: nothing, itself, something else, or several.

        Args:
            index: Its number in its direction, from 0.
            time_s: At which it is sent, s since the start.
            direction: See :data:`Direction`.
        """
        deliveries = [FaultyDelivery(data)]
        for fault, chance in self._of_datagrams[direction]:
            if not fault.covers(index, time_s):
                continue
            reordered = fault.kind == "reordered"
            deliveries = [
                FaultyDelivery(
                    arrived.of(one.data),
                    one.late_s + (0.0 if reordered else arrived.delay_s),
                    one.overtaken_by + int(reordered and arrived.delay_s > 0.0),
                )
                for one in deliveries
                for arrived in chance.decide(index)
            ]
        return deliveries

    def condition(self, index: int, time_s: float) -> Condition:
        """Condition of the instrument.

        Args:
            index: Number of the sample, from 0.
            time_s: At which it is taken, s since the start.
        """
        if not self._of_source:
            return SOUND
        hit: dict[str, bool] = dict.fromkeys(SOURCE_KINDS, False)
        bits, step, offset = 0, 0, [0.0, 0.0, 0.0]
        for fault, chance in self._of_source:
            if fault.kind in ("dying", "counter"):  # once begun, for good
                begun = index >= fault.first and time_s >= fault.from_s - _TICK_S
                hit[fault.kind] |= begun
                step += fault.step if begun else 0
                continue
            if not fault.covers(index, time_s) or chance.decide(index):
                continue
            hit[fault.kind] = True
            bits |= fault.bits
            offset = [a + b for a, b in zip(offset, fault.offset, strict=True)]
        return Condition(
            silent=hit["silent"] or hit["dying"],
            dead=hit["dying"],
            saturated=hit["saturated"],
            frozen=hit["frozen"],
            not_a_number=hit["nan"],
            beam_broken=hit["beam_broken"],
            bits=bits,
            offset=(offset[0], offset[1], offset[2]),
            step=step,
        )


class FaultyLine:
    """One direction of a connection. It has no clock of its own: every call says what time it is.

    Args:
        direction: Which of them are its.

    Attributes:
        offered: Datagrams put in so far.
        carried: Datagrams that came out so far.
    """

    def __init__(self, schedule: FaultSchedule, direction: Direction = "out") -> None:
        self._schedule, self._direction, self._spared = schedule, direction, schedule.spares(direction)
        self._late: list[tuple[float, int, bytes]] = []
        self._delayed: list[tuple[int, FaultyDelivery]] = []
        self._order = 0
        self.offered = self.carried = 0

    def put(self, data: bytes, time_s: float, deliver: Callable[[bytes], None]) -> None:
        """Put a datagram in; what is due comes out, the late ones of before first.

        Args:
            time_s: Now, s since the start; never less than in the call before.
            deliver: Told every datagram that comes out.
        """
        if self._spared:
            deliver(data)
            self.offered += 1
            self.carried += 1
            return
        self.release(time_s, deliver)
        waiting, self._delayed = self._delayed, []
        for delivery in self._schedule.deliveries(data, self.offered, time_s, self._direction):
            if delivery.overtaken_by:
                self._delayed.append((self.offered + delivery.overtaken_by, delivery))
            else:
                self._carry(delivery, time_s, deliver)
        for after, delivery in waiting:
            if after <= self.offered:
                self._carry(delivery, time_s, deliver)
            else:
                self._delayed.append((after, delivery))
        self.offered += 1

    def release(self, time_s: float, deliver: Callable[[bytes], None]) -> None:
        """Let out the late datagrams whose time has come, in the order of their times."""
        while self._late and self._late[0][0] <= time_s:
            deliver(heapq.heappop(self._late)[2])
            self.carried += 1

    def due_s(self) -> float:
        """Time at which the next late datagram comes out, s since the start; infinite where none is waiting."""
        return self._late[0][0] if self._late else math.inf

    def _carry(self, delivery: FaultyDelivery, time_s: float, deliver: Callable[[bytes], None]) -> None:
        if delivery.late_s > 0.0:
            self._order += 1
            heapq.heappush(self._late, (time_s + delivery.late_s, self._order, delivery.data))
        else:
            deliver(delivery.data)
            self.carried += 1
