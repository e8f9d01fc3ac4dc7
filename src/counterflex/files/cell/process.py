"""Table ``[process_limits]`` of a cell file: what spindle, tool and robot bear in the cut.

Fields are in shop units, as in the file; :meth:`ProcessLimitsTable.limits` is what they become in SI.
"""

from __future__ import annotations

import itertools
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.units import GPA, MM, RPM, UM
from counterflex.files.schema import Table
from counterflex.plan.process_limits import CARBIDE_PA, ProcessLimits

_Speed = Annotated[float, Field(ge=0.0, le=200_000.0)]
_Torque = Annotated[float, Field(gt=0.0, le=1e6)]


class ProcessLimitsTable(Table):
    """Limits of the process; what is left out is not known and binds nowhere."""

    spindle_min_rpm: Annotated[float, Field(gt=0.0, le=200_000.0)] | None = None
    spindle_max_rpm: Annotated[float, Field(gt=0.0, le=200_000.0)] | None = None
    spindle_power_w: Annotated[float, Field(gt=0.0, le=500_000.0)] | None = None
    spindle_torque_nm: Annotated[float, Field(gt=0.0, le=5000.0)] | None = None
    spindle_torque_curve_rpm_nm: Annotated[tuple[tuple[_Speed, _Torque], ...], Field(max_length=200)] = ()
    force_n: Annotated[float, Field(gt=0.0, le=100_000.0)] | None = None
    axis_torque_nm: tuple[_Torque, _Torque, _Torque, _Torque, _Torque, _Torque] | None = None
    tool_bending_um: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = None
    deflection_um: Annotated[float, Field(gt=0.0, le=100_000.0)] | None = None
    spindle_run_up_s: Annotated[float, Field(gt=0.0, le=600.0)] | None = None
    acceleration_mm_s2: Annotated[float, Field(gt=0.0, le=100_000.0)] | None = None

    @model_validator(mode="after")
    def _speeds(self) -> ProcessLimitsTable:
        low, high = self.spindle_min_rpm, self.spindle_max_rpm
        if low is not None and high is not None and low >= high:
            raise ValueError(f"spindle_min_rpm = {low:g} is not below spindle_max_rpm = {high:g}")
        speeds = [speed for speed, _ in self.spindle_torque_curve_rpm_nm]
        if len(speeds) == 1 or any(above <= below for below, above in itertools.pairwise(speeds)):
            raise ValueError(
                "spindle_torque_curve_rpm_nm needs at least two points [speed in rpm, torque in N m] of rising speed"
            )
        return self

    def limits(self, overhang_mm: float | None = None, modulus_gpa: float | None = None) -> ProcessLimits:
        """The same in SI.

        Args:
            overhang_mm: Of the tool, see ``[[tools]]``.
            modulus_gpa: Young's modulus of the tool; None is that of carbide.
        """
        return ProcessLimits(
            spindle_min_rad_s=_scaled(self.spindle_min_rpm, RPM),
            spindle_max_rad_s=_scaled(self.spindle_max_rpm, RPM),
            power_w=self.spindle_power_w,
            torque_nm=self.spindle_torque_nm,
            torque_by_speed=tuple((rpm * RPM, torque) for rpm, torque in self.spindle_torque_curve_rpm_nm),
            force_n=self.force_n,
            axis_torque_nm=None if self.axis_torque_nm is None else np.array(self.axis_torque_nm),
            bending_m=_scaled(self.tool_bending_um, UM),
            overhang_m=_scaled(overhang_mm, MM),
            modulus_pa=CARBIDE_PA if modulus_gpa is None else modulus_gpa * GPA,
            deflection_m=_scaled(self.deflection_um, UM),
            acceleration_m_s2=_scaled(self.acceleration_mm_s2, MM),
            run_up_s=self.spindle_run_up_s,
        )


def _scaled(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit
