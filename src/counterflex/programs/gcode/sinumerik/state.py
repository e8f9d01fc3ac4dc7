"""State of the Sinumerik reader between blocks, and the frames that TRANS and ROT set."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import INCH, MM
from counterflex.geometry import rotation
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Modal

_SAME_M: Final = 1e-12
_ZERO: Final = (0.0, 0.0, 0.0)
PLANE_AXES: Final[dict[int, tuple[int, int, int]]] = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
"""First and second axis of each plane, and its normal."""


@dataclass
class SinumerikState:
    """Everything that outlives a block; positions in the part frame, m."""

    vectors: bool = False  # The program gives the tool axis as A3 B3 C3 somewhere: TRAORI means that, else rotary words
    p_part: Float = field(default_factory=lambda: np.zeros(3))  # (3,) tool tip
    # Rotary axes, rad, or the components of the tool axis in the part frame under TRAORI with vectors
    angles: tuple[float, float, float] = _ZERO
    p_part_origin: Float = field(default_factory=lambda: np.zeros(3))  # (3,) zero of the programmed axes in the part
    R_part_work: Float | None = None  # (3, 3) programmed axes in the part; None where parallel
    work_offset: str = ""  # Settable offset that has been named first; its zero is that of the part
    machine_axes: bool = False  # G500 is active: the place of the part is not known
    # Axes along which it is known where the tool stands: they have been named absolutely
    named: set[int] = field(default_factory=set)
    # The tool starts at zero; else where it stands is not known along axes that are not ``named``
    start_known: bool = True
    line: int = 0  # 1-based line that is executed
    # Settable offsets in the part frame by name, m, from the cell file
    zeros: dict[str, Float] = field(default_factory=dict)
    zero: Float = field(default_factory=lambda: np.zeros(3))  # (3,) that of the active one, m
    offset_line: int = 0  # Line of the first settable offset
    mirrored: bool = False  # The axes are those of a mirror image
    # Axes whose zero has changed since they were named: line of the change and coordinate before it, m
    shifted: dict[int, tuple[int, float]] = field(default_factory=dict)
    # Setting SD42440: an incremental motion travels the change of the zero too; None: not known
    shift_travelled: bool | None = None
    motion: str = ""
    plane: int = 17
    unit: str = "G71"
    absolute: bool = True
    feed_mode: int = 94
    feed: float | None = None
    speed_rpm: float = 0.0
    spindle: int = 0
    tool: int = 0
    prepared: int | None = None
    traori: bool = False

    @property
    def unit_m(self) -> float:
        """Length of a unit of X Y Z and of frames, m."""
        return INCH if self.unit in ("G70", "G700") else MM

    @property
    def feed_unit_m(self) -> float:
        """Length of a unit of F, m: G70 and G71 leave it in mm, G700 and G710 take it along."""
        return INCH if self.unit == "G700" else MM

    @property
    def spindle_rpm(self) -> float:
        """Positive for M3."""
        return self.spindle * self.speed_rpm

    @property
    def tool_centre(self) -> int:
        """Meaning of X Y Z and of the words of direction, as :class:`~counterflex.programs.program.Modal` has it."""
        return 0 if not self.traori else TOOL_VECTOR if self.vectors else TOOL_CENTRE

    def to_work(self, p_part: Float) -> Float:
        """A point in the programmed axes, m from their zero."""
        away = p_part - self.p_part_origin
        return away if self.R_part_work is None else self.R_part_work.T @ away

    def to_part(self, p_work: Float) -> Float:
        """A point given in the programmed axes, in the part frame."""
        return self.p_part_origin + (p_work if self.R_part_work is None else self.R_part_work @ p_work)

    def turned(self, direction: Float) -> Float:
        """A direction given in the programmed axes, in part axes."""
        return direction if self.R_part_work is None else self.R_part_work @ direction

    def set_frame(self, name: str, shift_m: Float, rotvec_rad: Float) -> None:
        """Execute TRANS, ATRANS, ROT or AROT; the first and the third begin from the settable offset.

        ``p_part = p_part_origin + R_part_work p_work``; an additive frame is applied in the axes before it.

        Args:
            shift_m: (3,) in the axes before.
            rotvec_rad: (3,) rotation vector in the axes before.
        """
        if name in ("TRANS", "ROT", "MIRROR"):
            self.p_part_origin, self.R_part_work, self.mirrored = self.zero.copy(), None, False
        self.p_part_origin = self.p_part_origin + self.turned(shift_m)
        if np.any(rotvec_rad != 0.0):
            R = rotation.exp(rotvec_rad)
            self.R_part_work = R if self.R_part_work is None else self.R_part_work @ R
        if self.R_part_work is not None and np.allclose(self.R_part_work, np.eye(3), rtol=0.0, atol=1e-14):
            self.R_part_work = None

    def mirror(self, axes: set[int]) -> None:
        """Turn axes of the frame round (MIRROR, AMIRROR)."""
        M = np.diag([-1.0 if axis in axes else 1.0 for axis in range(3)])
        self.R_part_work = M if self.R_part_work is None else self.R_part_work @ M
        self.mirrored = float(np.linalg.det(self.R_part_work)) < 0.0
        if np.allclose(self.R_part_work, np.eye(3), rtol=0.0, atol=1e-14):
            self.R_part_work = None

    def note_shift(self, before: Float) -> None:
        """Note the axes whose coordinates (3,) m were other ones before the frame changed."""
        for axis, now in enumerate(self.to_work(self.p_part)):
            if axis not in self.shifted and abs(now - before[axis]) > _SAME_M:
                self.shifted[axis] = (self.line, float(before[axis]))

    def modal(self) -> Modal:
        """The state as writers see it."""
        R = self.R_part_work
        x, y, z = map(float, self.p_part_origin)
        return Modal(
            motion=self.motion or "G80",
            plane=self.plane,
            unit_m=self.unit_m,
            absolute=self.absolute,
            arc_absolute=False,
            feed_mode=self.feed_mode,
            p_part_origin=(x, y, z),
            tool=self.tool,
            spindle_rpm=self.spindle_rpm,
            tool_centre=self.tool_centre,
            feed_unit_m=self.feed_unit_m,
            R_part_work=None if R is None else tuple((float(a), float(b), float(c)) for a, b, c in R),
            not_written="a mirror image (MIRROR)" if self.mirrored else "",
        )
