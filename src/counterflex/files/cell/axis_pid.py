"""Table ``[online.axis_pid]`` of a cell file: a controller for the correction of each axis, in shop units."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import Field

from counterflex.core.units import MS, URAD
from counterflex.files.schema import Table
from counterflex.runtime.axis_gains import AXES, AxisGains

Gain: TypeAlias = Annotated[float, Field(ge=0.0, le=20.0)]
Rate: TypeAlias = Annotated[float, Field(ge=0.0, le=200.0)]
Time: TypeAlias = Annotated[float, Field(ge=0.0, le=1000.0)]
Angle: TypeAlias = Annotated[float, Field(gt=0.0, le=2e4)]


class AxisPidTable(Table):
    """One number for each axis."""

    proportional: tuple[Gain, Gain, Gain, Gain, Gain, Gain] = (0.0,) * 6
    integral_per_s: tuple[Rate, Rate, Rate, Rate, Rate, Rate] = (0.0,) * 6
    derivative_ms: tuple[Time, Time, Time, Time, Time, Time] = (0.0,) * 6
    filter_ms: tuple[Time, Time, Time, Time, Time, Time] = (0.0,) * 6
    most_urad: tuple[Angle, Angle, Angle, Angle, Angle, Angle] = (1000.0,) * 6

    @property
    def gains(self) -> tuple[AxisGains, ...]:
        """In SI, one per axis."""
        return tuple(
            AxisGains(
                self.proportional[k],
                self.integral_per_s[k],
                self.derivative_ms[k] * MS,
                self.filter_ms[k] * MS,
                self.most_urad[k] * URAD,
            )
            for k in range(AXES)
        )
