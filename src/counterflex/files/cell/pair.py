"""Table ``[online.pair]`` of a cell file: flange sensor and instrumented holder fused, in shop units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, TypeAlias

from pydantic import Field

from counterflex.core.units import MS
from counterflex.files.schema import Table

if TYPE_CHECKING:
    from counterflex.runtime.sensing.pair_wrench import PairTuning

Force: TypeAlias = Annotated[float, Field(gt=0.0, le=1e5)]
Age: TypeAlias = Annotated[float, Field(ge=0.0, le=1000.0)]


class PairTable(Table):
    """What the filter of two sensors is told beside their own tables."""

    sensor_noise_n: Force = 3.0
    sensor_zero_n: Force = 1.0
    sensor_walk_n: Force = 0.1
    sensor_late_ms: Age = 0.0
    holder_late_ms: Age = 0.0
    slew_n: Force = 1000.0
    gate: Annotated[float, Field(ge=2.0, le=20.0)] = 5.0
    differ_n: Force = 30.0
    differ_ms: Annotated[float, Field(gt=0.0, le=10_000.0)] = 100.0

    def tuning(self, holder_walk_n: tuple[float, float, float]) -> PairTuning:
        """In SI.

        Args:
            holder_walk_n: (3,) N over one second, holder axes, of what the zeros of the bridges look like.
        """
        from counterflex.runtime.sensing.pair_wrench import PairTuning  # with the compiler

        return PairTuning(
            noise_n=self.sensor_noise_n,
            zero_n=self.sensor_zero_n,
            walk_n=self.sensor_walk_n,
            holder_walk_n=holder_walk_n,
            slew_n=self.slew_n,
            late_s=(self.sensor_late_ms * MS, self.holder_late_ms * MS),
            gate=self.gate,
            differ_n=self.differ_n,
            differ_s=self.differ_ms * MS,
        )
