"""Two force sensors as one source of a session: both drained in each cycle, both zeros taken before arming."""

from __future__ import annotations

from counterflex.core.arrays import Float
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.session.strain_tare import StrainTare
from counterflex.protocols.session.tare import Tare
from counterflex.runtime.sensing.pair_kernel import FIRST, SECOND
from counterflex.runtime.sensing.pair_wrench import PairWrench


class PairSource:
    """A flange sensor and an instrumented holder, taken as a :class:`~counterflex.protocols.force.source.ForceSource`.

    Args:
        first: Flange sensor.
        second: Strains of the holder.
        wrench: Told which of them has something new.

    Attributes:
        good: Samples in the last drain, of the one that had more.
        saturated: Neither can be used, and one is beyond its range.
        frozen: Neither can be used, and one repeats itself.
    """

    def __init__(self, first: ForceSource, second: ForceSource, wrench: PairWrench) -> None:
        self.first_source, self.second_source, self._wrench = first, second, wrench
        self.w_sensor: Float = first.w_sensor
        self.samples: Float = first.samples[:0]
        self.good = 0
        self.saturated = self.frozen = False

    @property
    def first(self) -> int:
        """Sequence number of the flange sensor's first sample; -1: they do not come at 1 kHz, or it has none."""
        return self.first_source.first if len(self.samples) else -1

    def drain(self) -> int:
        """Take what both have; returns the number of good samples, 0 where neither can be used."""
        fresh, most = 0, 0
        beyond = still = False
        for bit, source in ((FIRST, self.first_source), (SECOND, self.second_source)):
            count = source.drain()
            beyond, still = beyond or source.saturated, still or source.frozen
            if count > 0 and not source.saturated and not source.frozen:
                fresh, most = fresh | bit, max(most, count)
        kept = self.first_source.good if fresh & FIRST else 0  # rows behind them are of an earlier drain
        self.w_sensor, self.samples = self.first_source.w_sensor, self.first_source.samples[:kept]
        self._wrench.fresh, self.good = fresh, kept or most
        self.saturated, self.frozen = fresh == 0 and beyond, fresh == 0 and still
        return most

    @property
    def record(self) -> tuple[Float, int, float]:
        """For the log: what the holder shows (6,), bits of the sensors that were used, and their difference in N."""
        return self.second_source.w_sensor, self._wrench.fresh, self._wrench.gap_n

    def close(self) -> None:
        """Free both ports."""
        self.first_source.close()
        self.second_source.close()


class PairTare(Tare):
    """Takes the zeros of both; nothing may be armed before both are accepted.

    Args:
        wrench: Whose zeros they are.
        force_n: Largest force that either may show without a cut.
        moment_nm: Largest moment.
        holder: Zero of the holder.
    """

    def __init__(self, wrench: PairWrench, force_n: float, moment_nm: float, holder: StrainTare) -> None:
        super().__init__(force_n, moment_nm, keep=False)
        self._wrench, self._holder = wrench, holder
        self._flange = Tare(force_n, moment_nm)

    def take(self, w: Float) -> None:
        """Take one reading of both.

        Args:
            w: Not used: the sensors are asked for.
        """
        del w
        if not self._flange.accepted:
            self._flange.take(self._wrench.w_first)
        if not self._holder.accepted:
            self._holder.take(self._wrench.second.w_part)
        self.refusals = max(self._flange.refusals, self._holder.refusals)
        self.mean[:] = self._flange.mean if self._flange.refusals or not self._holder.refusals else self._holder.mean
        if self._flange.accepted and self._holder.accepted and not self.accepted:
            self.accepted = True
            self._wrench.take_zero(self._flange.zero)

    def again(self) -> None:
        """Take new ones."""
        super().again()
        self._flange.again()
        self._holder.again()
        self._wrench.tared = False
