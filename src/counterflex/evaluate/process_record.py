"""Findings of process monitoring in a run: events with their places, the trend of wear, how much slower it went."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import plain
from counterflex.runtime.monitoring.events import EVENTS, Event
from counterflex.runtime.record_ring import WIDTH, column

FIRST_EVENTS: Final = 200
LAST_EVENTS: Final = 50
"""So many events of a run are kept one by one, from its beginning and from its end; all are counted."""


@dataclass(frozen=True)
class ProcessEvent:
    """Something that process monitoring found."""

    event: Event  # what
    cycle: int  # in which it was found, 1 is the loop's first
    time_s: float  # since the first record
    path_m: float  # place along the program, from its start
    # what was watched, in the unit of its kind: m of cut without force, N (or N m) of force, relative rise of the
    # ratio, share of the force lost, N of vibration
    value: float
    limit: float

    def shown(self) -> dict[str, Any]:
        """Event, time and place in plain values."""
        return plain(self, "event cycle time_s:3 path_mm:3")


@dataclass(frozen=True)
class ForceTrend:
    """Trend of the ratio of measured to predicted force."""

    cut_m: float  # length of cut
    trend_per_m: float  # change of the ratio per metre of cut
    sigma_per_m: float  # its standard deviation; 0 where the cut was too short to tell a trend
    degrees: float  # degrees of freedom of that, neighbouring stretches of cut being alike
    range_per_m: float  # half width of the interval that holds the trend in 95 % of all jobs; 0 where it is not known

    @property
    def known(self) -> bool:
        """Return whether the cut was long enough to tell a trend at all."""
        return self.degrees >= 1.0


@dataclass(frozen=True)
class ProcessFigures:
    """Figures of one run."""

    events: tuple[ProcessEvent, ...]  # the first FIRST_EVENTS and the last LAST_EVENTS, in order
    counts: dict[Event, int]  # all of them, by kind
    wear: ForceTrend | None  # at the end; None where nothing was cut
    slowed: float  # share of the cycles in which less than the programmed speed was asked for
    least_speed: float  # lowest share of the programmed speed that was asked for

    def shown(self) -> dict[str, Any]:
        """Shares of the programmed speed."""
        return plain(self, "slowed_share=slowed:4 least_speed:3")


class ProcessRecord:
    """Takes the records of one run piece by piece, in order."""

    def __init__(self) -> None:
        self._first: list[ProcessEvent] = []
        self._latest: deque[ProcessEvent] = deque(maxlen=LAST_EVENTS)
        self._counts = dict.fromkeys(Event, 0)
        self._begin: float | None = None
        self._cycles = self._slowed = 0
        self._least = 1.0
        self._last: Float | None = None

    def add(self, rows: Float) -> tuple[ProcessEvent, ...]:
        """Take records.

        Args:
            rows: (n, WIDTH) of :class:`counterflex.runtime.record_ring.RecordRing`.

        Returns:
            Events among them.

        Raises:
            InputError: Another shape, or an event that does not exist.
        """
        if rows.ndim != 2 or rows.shape[1] != WIDTH:
            raise InputError("records have the wrong shape", value=rows.shape, limit=("n", WIDTH))
        if len(rows) == 0:
            return ()
        if self._begin is None:
            self._begin = float(rows[0, column("received_ns")])
        requested = rows[:, column("speed_asked")]
        slow = (requested > 0.0) & (requested < 1.0)
        self._cycles += len(rows)
        self._slowed += int(slow.sum())
        self._least = min(self._least, float(requested[slow].min(initial=1.0)))
        return self._take_events(rows)

    def join(self, rows: Float, cycles: int, slowed: int, least: float) -> None:
        """Take what is known of a stretch of records without them.

        Args:
            rows: (k, WIDTH) its first and last record and those with events.
            slowed: Those in which less than the programmed speed was asked for.
            least: Lowest share of it.
        """
        if self._begin is None:
            self._begin = float(rows[0, column("received_ns")])
        self._cycles += cycles
        self._slowed += slowed
        self._least = min(self._least, least)
        self._take_events(rows)

    def sums(self) -> dict[str, float]:
        """Sums that :meth:`join` uses, by name."""
        return {"slowed": self._slowed, "least_speed": self._least}

    def _take_events(self, rows: Float) -> tuple[ProcessEvent, ...]:
        bits = rows[:, column("event_new")]
        good = (bits >= 0) & (bits < 1 << EVENTS) & (bits == np.floor(bits))
        if not good.all():
            raise InputError("a record holds a process event that does not exist", value=float(bits[~good][0]))
        results = [
            self._event(rows[k], event)
            for k in np.flatnonzero(bits)
            for event in Event
            if int(bits[k]) >> event & 1
        ]  # fmt: skip
        for event in results:
            self._counts[event.event] += 1
        room = FIRST_EVENTS - len(self._first)
        self._first += results[:room]
        self._latest.extend(results[room:])
        self._last = rows[-1].copy()
        return tuple(results)

    def _event(self, row: Float, event: Event) -> ProcessEvent:
        begin = self._begin if self._begin is not None else 0.0
        return ProcessEvent(
            event,
            int(row[column("cycle")]),
            (float(row[column("received_ns")]) - begin) * 1e-9,
            float(row[column("path_m")]),
            float(row[column(f"value_{event.name.lower()}")]),
            float(row[column(f"limit_{event.name.lower()}")]),
        )

    def figures(self) -> ProcessFigures:
        """Figures of what was taken so far."""
        wear = None
        if self._last is not None and self._last[column("cut_m")] > 0.0:
            names = ("cut_m", "wear_trend", "wear_trend_sigma", "wear_degrees")
            cut, slope, sigma, degrees = (float(self._last[column(name)]) for name in names)
            if not np.isnan(slope):  # a log of older code has no such column
                wide = sigma * float(scipy.special.stdtrit(degrees, 0.975)) if degrees >= 1.0 else 0.0
                wear = ForceTrend(cut, slope, sigma, degrees, wide)
        return ProcessFigures(
            (*self._first, *self._latest),
            {event: count for event, count in self._counts.items() if count},
            wear,
            self._slowed / max(1, self._cycles),
            self._least,
        )
