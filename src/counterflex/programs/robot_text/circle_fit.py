"""A circle through corrected points, where they lie on one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry.circle import angle_to, circle, turned
from counterflex.programs.program import Motion

Edit = tuple[int, int, str]
"""Start, end, and what stands there instead; the same start and end put something in."""


class Spans:
    """Edits of a text, applied together at the end, so that indices stay those of the source."""

    def __init__(self) -> None:
        self._edits: list[Edit] = []

    def replace(self, start: int, end: int, text: str) -> None:
        """Replace what stands between two indices."""
        self._edits.append((start, end, text))

    def insert(self, at: int, text: str) -> None:
        """Put something in, behind what was put in there already."""
        self._edits.append((at, at, text))

    def sorted(self) -> list[Edit]:
        """The edits in order of their places; those of one place as they were made."""
        return sorted(self._edits, key=lambda edit: (edit[0], edit[1]))

    def __eq__(self, other: object) -> bool:
        """Return whether two lists of edits make the same text."""
        return isinstance(other, Spans) and self.sorted() == other.sorted()

    def __hash__(self) -> int:
        """Not hashed by contents."""
        return id(self)

    def __iadd__(self, other: Spans) -> Spans:
        """Take the edits of another list too."""
        self._edits += other._edits
        return self

    def within(self, start: int, end: int) -> Spans:
        """The edits between two indices."""
        out = Spans()
        out._edits = [edit for edit in self._edits if start <= edit[0] and edit[1] <= end]
        return out

    def applied(self, text: str, start: int = 0, end: int | None = None) -> str:
        """The text between two indices with the edits."""
        end, out, at = len(text) if end is None else end, [], start
        for first, last, replacement in self.sorted():
            out += [text[at:first], replacement]
            at = last
        return "".join([*out, text[at:end]])


@dataclass(frozen=True, eq=False)
class FittedCircle:
    """A corrected circle."""

    motion: Motion  # The programmed one
    p_start: Float  # (3,) m, where it begins now
    centre: Float  # (3,) m
    normal: Float  # (3,) unit vector
    turn_rad: float  # Signed angle
    error_m: float  # Largest distance of a commanded point from it at the same share of the turn

    def at(self, p_nominal: Float) -> Float:
        """(3,) m, the point that stands for one of the programmed circle, at the same share of the turn."""
        motion = self.motion
        if motion.p_centre is None or motion.normal is None:
            raise ValueError("no circle")
        angle = angle_to(motion.p_start, p_nominal, motion.p_centre, motion.normal)
        if motion.turn_rad < 0.0:
            angle -= 2.0 * np.pi
        return turned(self.p_start, self.centre, self.normal, angle * self.turn_rad / motion.turn_rad)

    def end(self) -> Float:
        """(3,) m, its end."""
        return turned(self.p_start, self.centre, self.normal, self.turn_rad)


def fitted_circle(motion: Motion, points: Float, nominal: Float, *, fixed_turn: bool) -> FittedCircle | None:
    """The circle from the first commanded point through the middle one to the last.

    Args:
        points: (k + 1, 3) m, commanded, its start first.
        nominal: (k, 3) m, programmed points that the commanded ones behind the start stand for.
        fixed_turn: The program gives its angle (CA), which stays.

    Returns:
        The circle with its error; None where the points give none, or more than one turn is made.
    """
    if (
        len(points) < 3
        or motion.p_centre is None
        or motion.normal is None
        or abs(motion.turn_rad) >= 2.0 * np.pi - 1e-3
    ):
        return None
    through = circle(points[0], points[len(points) // 2], points[-1])
    if through is None:
        return None
    centre, normal = through
    if abs(float(normal @ motion.normal)) < 0.5:
        return None
    normal = normal if float(normal @ motion.normal) > 0.0 else -normal
    turn = angle_to(points[0], points[-1], centre, normal)
    turn = turn if motion.turn_rad > 0.0 else turn - 2.0 * np.pi
    turn = motion.turn_rad if fixed_turn else turn
    if abs(turn - motion.turn_rad) > 0.5 * abs(motion.turn_rad):
        return None
    fit = FittedCircle(motion, points[0], centre, normal, turn, 0.0)
    error = max(float(np.linalg.norm(fit.at(p) - commanded)) for p, commanded in zip(nominal, points[1:], strict=True))
    return FittedCircle(motion, points[0], centre, normal, turn, error)
