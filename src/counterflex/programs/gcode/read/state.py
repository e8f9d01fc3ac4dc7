"""What the interpreter remembers between blocks: position, offsets and modes, in m and degrees.

Positions are of the tool tip in the part frame: the interpreter's coordinates with the tool length offset taken out and
the work offset and G92 put in. Program value, part and machine are related by
``p_part = work_offset + g92 + value`` and ``p_machine = p_part + tool_length``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.errors import InputError
from counterflex.core.units import INCH, MM
from counterflex.programs.gcode.read.codes import CYCLES
from counterflex.programs.program import Modal

Six = tuple[float, float, float, float, float, float]
FOOT: Final = 12.0 * INCH
ZERO: Final[Six] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
WORK_OFFSETS: Final = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")


def plus(a: Six, b: Six) -> Six:
    """Return the sum of two six-axis points."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


def minus(a: Six, b: Six) -> Six:
    """Return the difference of two six-axis points."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5])


def six(values: Sequence[float]) -> Six:
    """Return three or six finite numbers as a six-axis point; missing rotary axes are 0."""
    numbers = [float(value) for value in values]
    if len(numbers) == 3:
        numbers += [0.0, 0.0, 0.0]
    if len(numbers) != 6 or not all(-1e9 < number < 1e9 for number in numbers):
        raise InputError("an offset needs three or six finite numbers", value=list(values))
    return (numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5])


def work_offset_table(given: Mapping[str, Sequence[float]] | None) -> dict[str, Six]:
    """Return all nine work offsets, zero where none is given.

    Args:
        given: Offsets by name ``G54`` ... ``G59.3``: x, y, z in m and, optionally, a, b, c in degrees.

    Raises:
        InputError: An unknown name, or numbers that are no offset.
    """
    table = dict.fromkeys(WORK_OFFSETS, ZERO)
    for name, values in (given or {}).items():
        if name not in table:
            raise InputError("an unknown work offset", value=name, limit=" ".join(WORK_OFFSETS))
        table[name] = six(values)
    return table


@dataclass
class State:
    """Everything that outlives a block.

    Attributes:
        position: Tool tip in the part frame, m and degrees.
        work_offsets: By name.
        work_offset: Name of the active one.
        g92: Active G92/G52 shift.
        g92_saved: What G92.3 brings back.
        tool_length: Active tool length offset.
        tool_centre: Tenths of G43.4 or G43.5 while active, else 0.
        motion: Tenths of the active motion code; 800 for none.
        plane: 17, 18 or 19.
        unit_m: Length of a program unit, m.
        absolute: G90.
        arc_absolute: G90.1.
        feed_mode: 93, 94 or 95.
        retract_initial: G98 (True) or G99.
        feed: F as programmed, in program units per minute (G94) or revolution (G95); None until set.
        feed_unit_m: Unit that ``feed`` was given in, m.
        speed_rpm: S; surface speed in m/min or ft/min while ``constant_surface``.
        constant_surface: G96.
        speed_limit: D of G96, rpm.
        spindle: +1 for M3, -1 for M4, 0 for M5.
        tool: In the spindle.
        prepared: Tool chosen by T; None before the first.
        cycle: Sticky words of the canned cycle by letter, in program units.
        cycle_initial: Height along the cycle's axis at which the running series of cycles began, m; None outside one.
        cycle_began: The same as the program said it there: plane, and height in program units.
    """

    work_offsets: dict[str, Six]
    position: Six = ZERO
    work_offset: str = "G54"
    g92: Six = ZERO
    g92_saved: Six = ZERO
    tool_length: Six = ZERO
    tool_centre: int = 0
    motion: int = 800
    plane: int = 17
    unit_m: float = MM
    absolute: bool = True
    arc_absolute: bool = False
    feed_mode: int = 94
    retract_initial: bool = False
    feed: float | None = None
    feed_unit_m: float = MM
    speed_rpm: float = 0.0
    constant_surface: bool = False
    speed_limit: float = 0.0
    spindle: int = 0
    tool: int = 0
    prepared: int | None = None
    cycle: dict[str, float] = field(default_factory=dict)
    cycle_initial: float | None = None
    cycle_began: tuple[int, float] = (17, 0.0)

    @property
    def origin(self) -> Six:
        """Program zero in the part frame."""
        return plus(self.work_offsets[self.work_offset], self.g92)

    @property
    def spindle_rpm(self) -> float:
        """Signed spindle speed; under G96 that at the present distance from X0, ``S / (2 pi |x|)``, at most D."""
        if not self.constant_surface:
            return self.spindle * self.speed_rpm
        surface_m = self.speed_rpm * (FOOT if self.unit_m == INCH else 1.0)
        around_m = 2.0 * math.pi * abs(self.position[0] - self.origin[0])
        fast = surface_m >= self.speed_limit * around_m
        return self.spindle * (self.speed_limit if fast else surface_m / around_m)

    def choose_motion(self, code: int) -> None:
        """Make a motion code active; sticky words end with their cycle, a series with the first other motion."""
        if code != self.motion:
            self.motion = code
            self.cycle.clear()
        if code not in CYCLES:
            self.cycle_initial = None

    def modal(self, machine: bool = False) -> Modal:
        """Return the state as writers see it; ``machine`` for a block with G53."""
        origin = minus(ZERO, self.tool_length) if machine else self.origin
        whole, tenth = divmod(self.motion, 10)
        return Modal(
            motion=f"G{whole}.{tenth}" if tenth else f"G{whole}",
            plane=self.plane,
            unit_m=self.unit_m,
            absolute=self.absolute or machine,
            arc_absolute=self.arc_absolute,
            feed_mode=self.feed_mode,
            p_part_origin=origin[:3],
            tool=self.tool,
            spindle_rpm=self.spindle_rpm,
            tool_centre=self.tool_centre,
        )
