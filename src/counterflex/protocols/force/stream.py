"""Samples of a force sensor that come by themselves, numbered or not: gaps, restarts, range, frozen readings, mean."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.records import records
from counterflex.protocols.force.source import LARGEST
from counterflex.protocols.sequence_kernel import ORDER, next_step

MOST_SAMPLES: Final = 512
"""Samples of one drain that are kept one by one; later ones still enter the mean."""
SATURATED: Final = 0.95
"""Share of the range at which a reading is not believed any more."""
FROZEN: Final = 25
"""Samples with the same six numbers in a row that no living sensor sends."""


class SampleStream:
    """A stream of samples as a :class:`counterflex.protocols.force.source.ForceSource`.

    Call :meth:`begin`, then :meth:`take` for each batch, then :meth:`end`, once per cycle of the loop.

    Args:
        range_n: Largest force that the sensor measures; 95 % of it counts as saturated. None: not watched.
        range_nm: Largest moment, likewise.
        bits: Of the numbers of the samples, after which they begin again at 0.

    Attributes:
        w_sensor: (6,) N, N m, mean of the good samples of the last cycle that had any.
        samples: (MOST_SAMPLES, 6) N, N m, the good ones of the last cycle one by one.
        first: Sequence number of the first of them where they come at 1 kHz by their own time stamps, else -1.
        good: Good samples in the last cycle.
        saturated: One of them was beyond the range, or the sensor said so.
        frozen: The readings have not changed for 25 samples.
        lost: Samples missing between the numbers, in all.
        bad: Samples that the sensor itself calls invalid, in all.
        malformed: What was no sample, in all.

    Raises:
        InputError: A range is not above 0.
    """

    def __init__(self, *, range_n: float | None = None, range_nm: float | None = None, bits: int = 32) -> None:
        limits = [np.inf if value is None else value for value in (range_n, range_nm)]
        if not min(limits) > 0.0:
            raise InputError("the range of the force sensor is not above 0", value=min(limits))
        self._mask, self._order = (1 << bits) - 1, records(ORDER)
        self._order["newest"] = -1
        self._limit: Float = SATURATED * np.repeat(limits, 3)
        self._last: Float = np.full(6, np.nan)
        self._same = 0
        self._origin: tuple[int, int] | None = None
        self._kilohertz = False
        self._sum: Float = np.zeros(6)
        self.w_sensor: Float = np.zeros(6)
        self.samples: Float = np.zeros((MOST_SAMPLES, 6))
        self.first, self.good = -1, 0
        self.saturated = self.frozen = False
        self.lost = self.bad = self.malformed = 0

    @property
    def restarts(self) -> int:
        """Number of times that the source began to count again."""
        return int(self._order["restarts"][0])

    def begin(self) -> None:
        """Begin a cycle."""
        self.first, self.good = -1, 0
        self.saturated = False
        self._sum[:] = 0.0

    def take(
        self,
        w: Float,
        *,
        sequence: NDArray[np.integer] | None = None,
        time_ns: NDArray[np.integer] | None = None,
        invalid: Bool | None = None,
        saturated: Bool | None = None,
    ) -> None:
        """Take samples in their order.

        Args:
            w: (k, 6) N, N m; a row that is not finite, or beyond 1e6, counts as invalid.
            sequence: (k,) numbers, or None: every sample counts as a new one.
            time_ns: (k,) clock of the source, or None.
            invalid: (k,) the sensor says that it has no value.
            saturated: (k,) the sensor says that it is beyond its range.
        """
        kept = self._in_order(sequence, time_ns, len(w))
        if len(kept) == 0:
            return
        usable: Bool = np.asarray(np.all(np.abs(w[kept]) <= LARGEST, axis=1))  # a NaN is not
        if invalid is not None:
            usable &= ~invalid[kept]
        self.bad += int(np.sum(~usable))
        if saturated is not None and np.any(saturated[kept]):
            self.saturated = True
            usable &= ~saturated[kept]
        good = w[kept][usable]
        if len(good) == 0:
            return
        self.saturated |= bool(np.any(np.abs(good) > self._limit))
        changed: Bool = np.any(np.diff(np.concatenate([self._last[None], good]), axis=0) != 0.0, axis=1)
        places = np.flatnonzero(changed)
        self._same = self._same + len(good) if len(places) == 0 else len(good) - 1 - int(places[-1])
        self._last = good[-1].copy()
        if self.good == 0 and sequence is not None and self._kilohertz:
            self.first = int(sequence[kept[np.flatnonzero(usable)[0]]])
        fits = min(len(good), MOST_SAMPLES - min(self.good, MOST_SAMPLES))
        self.samples[self.good : self.good + fits] = good[:fits]
        self.good += len(good)
        self._sum += good.sum(axis=0)

    def end(self) -> int:
        """End a cycle; returns the number of good samples. With none the mean is left as it was."""
        if self.good > 0:
            np.divide(self._sum, self.good, out=self.w_sensor)
        self.frozen = self._same >= FROZEN - 1
        return self.good

    def _in_order(self, sequence: NDArray[np.integer] | None, time_ns: NDArray[np.integer] | None, count: int) -> Int:
        """Places of the new samples: numbers go on by their order, late and repeated ones are passed over."""
        if sequence is None:
            return np.arange(count)
        kept = []
        for k, number in enumerate(sequence.tolist()):
            before, step = self.restarts, next_step(self._order, number, self._mask)
            if step == 0:
                continue
            if self.restarts != before:
                self._origin = None
            self.lost += step - 1
            if time_ns is not None:
                self._pace(number, int(time_ns[k]))
            kept.append(k)
        return np.array(kept, dtype=np.int64)

    def _pace(self, sequence: int, time_ns: int) -> None:
        """Test whether the stream comes at 1 kHz, by the source's own numbers and times."""
        if self._origin is None:
            self._origin, self._kilohertz = (sequence, time_ns), False
            return
        steps = (sequence - self._origin[0]) & self._mask
        if steps >= 100:
            self._kilohertz = abs((time_ns - self._origin[1]) / steps - 1e6) < 2e4
            self._origin = (sequence, time_ns)
