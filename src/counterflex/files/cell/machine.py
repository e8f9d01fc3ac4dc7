"""The table ``[machine]``: rotary axes of the milling machine that the programs were written for.

Table ``[process_limits]`` of a cell file: what spindle, tool and robot bear in the cut.

Fields are in shop units, as in the file; :meth:`ProcessLimitsTable.limits` is what they become in SI.
"""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.errors import InputError
from counterflex.core.units import DEG, GPA, MM, RPM, UM
from counterflex.files.schema import Length, Table
from counterflex.plan.process_limits import CARBIDE_PA, ProcessLimits
from counterflex.programs.rotary.machine import RotaryAxis, RotaryMachine

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


Component = Annotated[float, Field(ge=-1.0, le=1.0)]
Turn = Annotated[float, Field(ge=-1e6, le=1e6)]


class RotaryAxisTable(Table):
    """One rotary axis: its word, what it carries, and where it lies with all axes at zero."""

    word: Literal["A", "B", "C"]
    moves: Literal["table", "head"]
    direction: tuple[Component, Component, Component]
    x_mm: Length = 0.0
    y_mm: Length = 0.0
    z_mm: Length = 0.0
    min_deg: Turn = -1e6
    max_deg: Turn = 1e6

    @model_validator(mode="after")
    def _sound(self) -> RotaryAxisTable:
        if float(np.linalg.norm(self.direction)) < 1e-6:
            raise ValueError("the direction of a rotary axis has no length; expected for example [0, 0, 1]")
        if not self.min_deg < self.max_deg:
            raise ValueError(f"min_deg = {self.min_deg:g} is not below max_deg = {self.max_deg:g}")
        return self

    def axis(self) -> RotaryAxis:
        """The axis in SI."""
        direction = np.array(self.direction)
        return RotaryAxis(
            self.word,
            self.moves,
            direction / np.linalg.norm(direction),
            np.array([self.x_mm, self.y_mm, self.z_mm]) * MM,
            (self.min_deg * DEG, self.max_deg * DEG),
        )


class MachineTable(Table):
    """Rotary axes from the bed outward, and whether XYZ is always the tool tip in the part."""

    axes: Annotated[tuple[RotaryAxisTable, ...], Field(min_length=1, max_length=2)]
    always_tool_centre: bool = False

    @model_validator(mode="after")
    def _machine(self) -> MachineTable:
        try:
            self.machine()
        except InputError as fault:
            raise ValueError(f"{fault.what}: {fault.value}") from fault
        return self

    def machine(self) -> RotaryMachine:
        """The machine in SI."""
        return RotaryMachine(tuple(axis.axis() for axis in self.axes), self.always_tool_centre)
