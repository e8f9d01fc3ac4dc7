"""The table ``[machine]``: rotary axes of the milling machine that the programs were written for."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.files.schema import Length, Table
from counterflex.programs.rotary.machine import RotaryAxis, RotaryMachine

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
