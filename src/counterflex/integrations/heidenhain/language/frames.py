"""Coordinate transformations of Klartext: datum shift, mirror image, rotation, scaling, tilted working plane.

Each one is ``p_before = A p_behind + shift``; they act one after the other, in the order of their definitions.

Sources: HEIDENHAIN TNC 620 (81760x-05), Conversational Programming, "Workpiece coordinate system W-CS" (the result of
transformations depends on their sequence), "PLANE SPATIAL" (A-B-C about the non-tilted axes, the same as C-B-A about
the tilted ones: ``R = Rz(SPC) Ry(SPB) Rx(SPA)``), "PLANE EULER"; iTNC 530 (340 49x-02), "PLANE VECTOR" (base vector:
direction of X, normal vector: of the tool axis); TNC 410, Cycle 11 (machine parameter 7410 decides whether it scales
the tool axis); TNC 620 (34056x-02), Cycle Programming, Cycle 26.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import DEG
from counterflex.geometry import rotation

Kind = Literal["7", "8", "10", "26", "plane"]
NAMES: Final[dict[str, str]] = {
    "7": "cycle 7", "8": "cycle 8", "10": "cycle 10", "26": "cycle 26", "plane": "PLANE",
}  # fmt: skip
_SAME: Final = 1e-12
_SQUARE: Final = 1e-4


class FrameFault(ValueError):
    """A transformation whose place among the others is not known, or that is none."""

    def __init__(self, what: str, hint: str) -> None:
        super().__init__(what)
        self.what, self.hint = what, hint


@dataclass(frozen=True)
class FrameStep:
    """One transformation: ``p_before = A p_behind + shift``, m."""

    kind: Kind
    A: Float
    shift_m: Float

    @property
    def is_identity(self) -> bool:
        """It changes nothing."""
        return bool(np.allclose(self.A, np.eye(3), rtol=0.0, atol=1e-14)) and not np.any(self.shift_m)


def composed(steps: list[FrameStep]) -> tuple[Float, Float]:
    """Matrix (3, 3) and zero (3,) m of programmed coordinates in the part."""
    A, t = np.eye(3), np.zeros(3)
    for step in steps:
        t = t + A @ step.shift_m
        A = A @ step.A
    return A, t


class KlartextFrames:
    """The active transformations.

    Attributes:
        A: (3, 3) programmed axes in the part, with scales.
        t: (3,) m, their zero.
    """

    def __init__(self) -> None:
        self._steps: list[FrameStep] = []
        self.shift: Float = np.zeros(3)  # (3,) m, datum shift of cycle 7
        self.angle_deg = 0.0  # Angle of cycle 10
        self.mirrored: frozenset[int] = frozenset()  # Axes of cycle 8
        self.A, self.t = composed([])

    def memory(self) -> object:
        """Return all that decides about later transformations."""
        return [[(step.kind, step.A.tolist(), step.shift_m.tolist()) for step in self._steps], self.shift.tolist(),
                self.angle_deg, sorted(self.mirrored)]  # fmt: skip

    def has(self, *kinds: str) -> str:
        """Return the name of the first active transformation of these kinds; empty where none is."""
        return next((NAMES[step.kind] for step in self._steps if step.kind in kinds), "")

    def put(self, kind: Kind, A: Float, shift_m: Float) -> None:
        """Let a transformation take the place of the one of its kind.

        Raises:
            FrameFault: Others were defined behind that one, and it matters which acts first.
        """
        step = FrameStep(kind, A, shift_m)
        others = [other for other in self._steps if other.kind != kind]
        if step.is_identity:
            self._steps = others
        else:
            place = next((k for k, other in enumerate(self._steps) if other.kind == kind), len(self._steps))
            in_place = [*self._steps[:place], step, *self._steps[place + 1 :]]
            behind = [*others, step]
            one, two = composed(in_place), composed(behind)
            if max(float(np.abs(a - b).max()) for a, b in zip(one, two, strict=True)) > _SAME:
                later = NAMES[self._steps[-1].kind]
                raise FrameFault(
                    f"{NAMES[kind]} is defined again while {later} is active: which of them acts first is not known",
                    f"Reset {later} before, and define both again",
                )
            self._steps = in_place
        self.A, self.t = composed(self._steps)

    def set_shift(self, given: dict[int, tuple[float, bool]]) -> None:
        """Execute cycle 7: value, m, and whether it is incremental, by axis; other axes keep their shift."""
        shift = self.shift.copy()
        for axis, (value, incremental) in given.items():
            shift[axis] = value + (shift[axis] if incremental else 0.0)
        self.put("7", np.eye(3), shift)
        self.shift = shift

    def set_mirror(self, axes: frozenset[int]) -> None:
        """Execute cycle 8."""
        self.put("8", np.diag([-1.0 if axis in axes else 1.0 for axis in range(3)]), np.zeros(3))
        self.mirrored = axes

    def set_rotation(self, angle_deg: float, incremental: bool) -> None:
        """Execute cycle 10: about the tool axis Z, counter-clockwise."""
        angle = angle_deg + (self.angle_deg if incremental else 0.0)
        self.put("10", rotation.about_z(angle * DEG), np.zeros(3))
        self.angle_deg = angle

    def set_scale(self, factors: Float, centre_m: Float) -> None:
        """Execute cycle 26: factors (3,) about a centre (3,) m."""
        self.put("26", np.diag(factors), centre_m - factors * centre_m)

    def set_plane(self, R: Float, relative: bool = False) -> None:
        """Tilt the working plane about the datum; ``R`` (3, 3) in untilted axes, or in those of the active plane.

        Raises:
            FrameFault: Other transformations than a datum shift are active.
        """
        other = self.has("8", "10", "26")
        if other:
            raise FrameFault(f"the working plane is tilted while {other} is active", f"Reset {other} before")
        if relative:
            before = next((step.A for step in self._steps if step.kind == "plane"), np.eye(3))
            if self._steps and self._steps[-1].kind == "7" and self.has("plane"):
                raise FrameFault("PLANE RELATIV behind a datum shift in the tilted plane", "Reset cycle 7 before")
            R = before @ R
        self.put("plane", R, np.zeros(3))


def spatial(a_deg: float, b_deg: float, c_deg: float) -> Float:
    """Rotation (3, 3) of spatial angles: about X, then Y, then Z of the untilted axes."""
    out: Float = rotation.about_z(c_deg * DEG) @ rotation.about_y(b_deg * DEG) @ rotation.about_x(a_deg * DEG)
    return out


def euler(precession_deg: float, nutation_deg: float, turn_deg: float) -> Float:
    """Rotation (3, 3) about Z, the new X, and the new Z."""
    out: Float = (
        rotation.about_z(precession_deg * DEG) @ rotation.about_x(nutation_deg * DEG) @ rotation.about_z(turn_deg * DEG)
    )
    return out


def by_vectors(base: Float, normal: Float) -> Float:
    """Rotation (3, 3) whose X is a base vector and whose Z is a normal vector, each of any length.

    Raises:
        FrameFault: They have no length, or are not perpendicular.
    """
    sizes = float(np.linalg.norm(base)), float(np.linalg.norm(normal))
    if min(sizes) < _SQUARE:
        raise FrameFault("a vector of the working plane has no length", "BX BY BZ: direction of X, NX NY NZ: normal")
    x, z = base / sizes[0], normal / sizes[1]
    if abs(float(x @ z)) > _SQUARE:
        raise FrameFault("the vectors of the working plane are not perpendicular",
                         "BX BY BZ lies in the plane, NX NY NZ stands on it")  # fmt: skip
    x = x - float(x @ z) * z
    x = x / float(np.linalg.norm(x))
    return np.column_stack([x, np.cross(z, x), z])


def by_points(points: Float) -> Float:
    """Rotation (3, 3) of the plane through three points (3, 3): X from the first to the second, Y towards the third.

    Raises:
        FrameFault: They lie on a line.
    """
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    if float(np.linalg.norm(normal)) < 1e-9:
        raise FrameFault("the three points of the working plane lie on a line", "Give three corners of a triangle")
    return by_vectors(points[1] - points[0], normal / float(np.linalg.norm(normal)))
