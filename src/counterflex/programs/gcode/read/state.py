"""State of the interpreter between blocks: position, offsets and modes, in m and degrees.

Positions are of the tool tip in the part frame: the interpreter's coordinates with the tool length offset taken out and
the work offset and G92 put in. Program value, part and machine are related by
``p_part = work_offset + g92 + value`` and ``p_machine = p_part + tool_length``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.units import INCH, MM
from counterflex.programs.gcode.read.codes import CYCLES
from counterflex.programs.gcode.read.work_offsets import ZERO, Frame, Six, WorkOffsets
from counterflex.programs.program import Modal

FOOT: Final = 12.0 * INCH


def plus(a: Six, b: Six) -> Six:
    """Return the sum of two six-axis points."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


def minus(a: Six, b: Six) -> Six:
    """Return the difference of two six-axis points."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5])


@dataclass
class ModalState:
    """Everything that outlives a block."""

    work_offsets: WorkOffsets  # Zeros by name
    unknown: set[int] = field(default_factory=set)  # Axes (0 to 2) along which it is not known where the tool stands
    position: Six = ZERO  # Tool tip in the part frame, m and degrees
    work_offset: str = "G54"  # Name of the active one
    g92: Six = ZERO  # Active G92/G52 shift
    g92_saved: Six = ZERO  # What G92.3 brings back
    tool_length: Six = ZERO  # Active tool length offset
    tool_centre: int = 0  # Tenths of G43.4 or G43.5 while active, else 0
    motion: int = 800  # Tenths of the active motion code; 800 for none
    plane: int = 17  # 17, 18 or 19
    unit_m: float = MM  # Length of a program unit, m
    absolute: bool = True  # G90
    arc_absolute: bool = False  # G90.1
    feed_mode: int = 94  # 93, 94 or 95
    retract_initial: bool = False  # G98 (True) or G99
    feed: float | None = None  # F as programmed, in program units per minute (G94) or revolution (G95); None until set
    feed_unit_m: float = MM  # Unit that ``feed`` was given in, m
    speed_rpm: float = 0.0  # S; surface speed in m/min or ft/min while ``constant_surface``
    constant_surface: bool = False  # G96
    speed_limit: float = 0.0  # D of G96, rpm
    spindle: int = 0  # +1 for M3, -1 for M4, 0 for M5
    tool: int = 0  # In the spindle
    prepared: int | None = None  # Tool chosen by T; None before the first
    # Sticky words of the canned cycle by letter, in program units
    cycle: dict[str, float] = field(default_factory=dict)
    cycle_absolute: dict[str, bool] = field(default_factory=dict)  # G90 was in force where each was stated
    # Height along the cycle's axis at which the running series of cycles began, m; None outside one
    cycle_initial: float | None = None
    # The same as the program said it there: plane, and height in program units
    cycle_began: tuple[int, float] = (17, 0.0)
    frame: Frame = field(default_factory=Frame)  # Rotation (G68), mirror image (G51.1) and polar coordinates (G16)
    polar: dict[int, float] = field(default_factory=dict)  # Radius (m) and angle (deg) in force by axis, under G16
    of_fanuc: bool = False  # The program was written for Fanuc or Haas: D selects an offset, G53 is a rapid
    fanuc_offsets: bool = False  # G10 L20 sets the offsets of G54.1, which the program uses; else those of LinuxCNC
    lengths_known: bool = True  # Tool lengths are those of the machine's tool table
    g92_known: bool = True  # No offset that an earlier program left can come back by G92.3

    @property
    def idle(self) -> str:
        """Words that any block may have: D of Fanuc selects a cutter radius offset, which G41 alone uses."""
        return "D" if self.of_fanuc else ""

    def motion_of(self, machine: bool) -> int:
        """Motion code in force, in tenths; a block of Fanuc with G53 (``machine``) is a rapid under any of them."""
        return 0 if machine and self.of_fanuc and self.motion != 10 else self.motion

    @property
    def origin(self) -> Six:
        """Program zero in the part frame."""
        return plus(self.work_offsets[self.work_offset], self.g92)

    @property
    def plain(self) -> bool:
        """Return whether straight moves need no more than the sum of value and origin."""
        return self.feed_mode == 94 and not self.unknown and self.work_offsets.fixed and self.frame.plain

    def to_work(self, position: Six) -> Six:
        """Return a point in the programmed axes, from program zero."""
        return self.frame.to_work(minus(position, self.origin))

    def to_part(self, work: Six) -> Six:
        """Return a point that is given in the programmed axes."""
        return plus(self.origin, self.frame.to_part(work))

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
        origin = minus(ZERO, self.tool_length) if machine else plus(self.origin, self.frame.to_part(ZERO))
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
            R_part_work=None if machine else self.frame.rows,
            not_written=self.frame.not_written,
        )
