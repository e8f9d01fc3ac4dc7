"""State of the control between the statements of a Klartext program."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import INCH, MM
from counterflex.integrations.heidenhain.language.cycles import FNumber
from counterflex.integrations.heidenhain.language.frames import KlartextFrames
from counterflex.programs.program import TOOL_CENTRE, TOOL_VECTOR, Modal

_UPRIGHT = (0.0, 0.0, 1.0)
Polar = tuple[float, float]
"""Radius, m, and angle, rad, about the pole."""
Plane = tuple[int, int, int]
"""First and second axis of a plane, and the one that completes them to a right-handed frame."""
MAIN_PLANE: Plane = (0, 1, 2)
PLANES: dict[int, Plane] = {17: MAIN_PLANE, 18: (2, 0, 1), 19: (1, 2, 0)}
"""Planes by the number that G-code gives them."""


@dataclass
class KlartextState:
    """Everything that outlives a statement; positions in the part frame, m."""

    # The program tilts the working plane or gives tool vectors: the tool axis is a vector in the part
    vectors: bool = False
    inch: bool = False  # Lengths are in inches, feeds in 1/10 inch/min
    # The tool starts at zero; else where it stands is not known along axes that are not ``named``
    start_known: bool = True
    frames: KlartextFrames = field(default_factory=KlartextFrames)
    p_part: Float = field(default_factory=lambda: np.zeros(3))  # (3,) tool tip
    # Rotary axes, rad; under ``vectors`` the tool axis in the part
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    named: set[int] = field(default_factory=set)  # Axes along which it is known where the tool stands
    # Coordinates named so far in a plane that was tilted anew, m; None where the place is known
    partial: dict[int, float] | None = None
    shifted: set[int] = field(default_factory=set)  # Axes whose zero has changed since they were named absolutely
    # Axes that a rotation, mirror image or scale mixes and that must be named together first
    settle: frozenset[int] = frozenset()
    pole_m: tuple[float, float] | None = None  # (2,) pole CC along ``pole_axes``, m
    pole_axes: Plane = MAIN_PLANE  # Plane of the pole: X and Y, Y and Z, or Z and X; its angles count from the first
    plane: Plane = MAIN_PLANE  # That of the path function last executed
    polar_point: Polar | None = None  # Where the last motion ended, if its words were polar
    aligned: bool = True  # The tool stands at right angles to the working plane
    motion: str = "G80"
    feed: float | None = None  # Number of F; ``per_turn`` where it is per revolution, ``called_feed`` that of TOOL CALL
    called_feed: FNumber | None = None
    per_turn: bool = False
    speed_rpm: float = 0.0
    spindle: int = 0
    tool: int = 0
    shortest: bool = False  # M126: rotary axes go the shortest way
    tcpm: bool = False  # M128 or FUNCTION TCPM

    def __post_init__(self) -> None:
        """Begin with the tool upright."""
        if self.vectors:
            self.angles = _UPRIGHT

    @property
    def unit_m(self) -> float:
        """Length of a unit, m."""
        return INCH if self.inch else MM

    @property
    def feed_unit_m(self) -> float:
        """Length of a unit of F per minute, m: mm, or a tenth of an inch (posts of CAM systems multiply by 10)."""
        return 0.1 * INCH if self.inch else MM

    def to_work(self, p_part: Float) -> Float:
        """Return a point in programmed axes, m."""
        out: Float = np.asarray(np.linalg.solve(self.frames.A, p_part - self.frames.t), dtype=np.float64)
        return out

    def to_part(self, p_work: Float) -> Float:
        """Return a point given in programmed axes, in the part, m."""
        out: Float = self.frames.t + self.frames.A @ p_work
        return out

    @property
    def is_turned(self) -> bool:
        """Programmed axes are not those of the part."""
        return not np.array_equal(self.frames.A, np.eye(3))

    @property
    def plane_axis(self) -> tuple[float, float, float]:
        """Normal of the working plane in the part."""
        z = self.frames.A[:, 2] if self.frames.has("plane") else np.array(_UPRIGHT)
        x, y, z = (z / float(np.linalg.norm(z))).tolist()
        return (x, y, z)

    def frame_changed(self, before: tuple[Float, Float], tilted: bool) -> None:
        """Note what a new frame leaves unknown.

        Args:
            before: Matrix and zero of the frame before.
            tilted: The working plane was tilted: where the tool stands in the part is not known.
        """
        A, t = self.frames.A, self.frames.t
        if np.array_equal(before[0], A) and np.array_equal(before[1], t):
            return
        self.pole_m = self.polar_point = None
        self.pole_axes = MAIN_PLANE
        turned = np.abs(before[0] - A).max(axis=0) > 0.0
        moved = np.abs(self.to_work(self.p_part) - np.linalg.solve(before[0], self.p_part - before[1])) > 1e-12
        self.shifted |= {int(axis) for axis in np.flatnonzero(turned | moved)}
        if tilted:
            self.named, self.partial, self.settle = set(), {}, frozenset()
            return
        self.settle = self.settle | frozenset(int(axis) for axis in np.flatnonzero(turned))
        if len(self.named) < 3:
            self.named -= self.settle

    def modal(self) -> Modal:
        """Return the state as writers see it."""
        A, (x, y, z) = self.frames.A, map(float, self.frames.t)
        reason = self.frames.has("8", "26")
        return Modal(
            motion=self.motion,
            plane=next(code for code, axes in PLANES.items() if axes == self.plane),
            unit_m=self.unit_m,
            absolute=True,
            arc_absolute=True,
            feed_mode=95 if self.per_turn else 94,
            p_part_origin=(x, y, z),
            tool=self.tool,
            spindle_rpm=self.spindle * self.speed_rpm,
            tool_centre=TOOL_VECTOR if self.vectors else TOOL_CENTRE if self.tcpm else 0,
            feed_unit_m=self.feed_unit_m,
            R_part_work=tuple((float(a), float(b), float(c)) for a, b, c in A) if self.is_turned else None,
            not_written=f"a mirror image or scale ({reason})" if reason else "",
        )
