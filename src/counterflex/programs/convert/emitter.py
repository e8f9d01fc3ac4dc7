"""Writing the steps of a program in a language: what all of them do the same way."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.core.units import DEG
from counterflex.geometry import rotation
from counterflex.programs.convert.steps import MachineFunction, Move, Step
from counterflex.programs.program import Program

UPRIGHT: Final = 5e-5


@dataclass(frozen=True)
class Conversion:
    """A program that is to be written in another language."""

    program: Program  # As read
    stem: str  # Name of what is written, without ending
    tolerance_m: float  # Largest distance of straight pieces from a circle that the language does not have
    cell: Any  # The :class:`~counterflex.files.cell.cell.Cell`
    points_per_file: int | None = None  # Most motions of a file; None takes the limit of the language


@dataclass
class Written:
    """A program in another language."""

    files: dict[str, str] = field(default_factory=dict)  # Text by name; the program itself first
    # For each motion that is written, by its index: shares of its way at which its pieces end
    pieces: dict[int, list[float]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # What the user should know, one sentence each


class ProgramEmitter(ABC):
    """Writes steps.

    Args:
        source: Name of the program, for errors and the comment at the head.
        name: Of what is written, without ending.
        tolerance_m: Largest distance of straight pieces from a circle that the language does not have.
    """

    language: ClassVar[str]
    partial: ClassVar[bool] = False
    """Motions may name fewer than three axes."""

    def __init__(self, source: str, name: str, tolerance_m: float) -> None:
        self.source, self.name, self.tolerance_m = Path(source).name, name, tolerance_m
        self.lines: list[str] = []
        self.pieces: dict[int, list[float]] = {}
        self.warnings: list[str] = []
        self.turning = False
        self.first = True
        self.exact = False
        self._chords = 0

    def write(self, steps: Sequence[Step]) -> Written:
        """Write all steps. Raises ProgramError: the language cannot say one; names line and word."""
        self.turning = any(map(_tilted, steps))
        self.begin()
        for at, step in enumerate(steps):
            if isinstance(step, str):
                self.comment(step)
            elif isinstance(step, MachineFunction):
                self.process(step)
            elif step.motion.kind == "dwell":
                self.dwell(step)
                self.pieces[step.index] = []
            elif len(step.named) == 3 or (self.partial and step.motion.kind == "rapid"):
                following = next((other for other in steps[at + 1 :] if not isinstance(other, str)), None)
                stops = not isinstance(following, Move) or following.motion.kind == "dwell"
                self._move(step, stops)
        if self._chords:
            self.warnings.append(
                f"{self._chords} circles that {self.language} does not have are written as straight moves within "
                f"{self.tolerance_m * 1e6:g} um"
            )
        return Written(self.end(), self.pieces, self.warnings)

    def _move(self, move: Move, stops: bool) -> None:
        motion = move.motion
        stops = stops or move.exact
        if motion.kind == "arc" and not self.first:
            shares = self.arc_shares(move)
            if shares is not None:
                begin = 0.0
                for share in shares:
                    self.exact = stops and share >= 1.0
                    self.arc(move, begin, share)
                    begin = share
                self.pieces[move.index] = shares
                return
            shares = self._chord_shares(move)
            self._chords += 1
        else:
            self.refuse_turn(move)
            shares = [1.0]
        for share in shares:
            self.exact = stops and share >= 1.0
            self.straight(move, share)
        self.pieces[move.index] = shares
        self.first = False

    def _chord_shares(self, move: Move) -> list[float]:
        motion = move.motion
        if motion.p_centre is None:
            return [1.0]
        radius = float(np.linalg.norm(np.asarray(motion.p_start) - motion.p_centre))
        step = 2.0 * math.acos(max(1.0 - self.tolerance_m / max(radius, self.tolerance_m), 0.0))
        count = max(2, math.ceil(abs(motion.turn_rad) / max(step, 1e-4)))
        return [k / count for k in range(1, count + 1)]

    def orientation(self, move: Move, share: float) -> Float:
        """(3, 3) orientation of the TCP frame at a share of a motion."""
        if share >= 1.0:
            return move.R_part_tcp
        out: Float = move.R_part_start @ rotation.exp(share * rotation.log(move.R_part_start.T @ move.R_part_tcp))
        return out

    @abstractmethod
    def refuse_turn(self, move: Move) -> None:
        """Refuse a feed that only turns the tool, where the language has no speed for it."""

    def refuse(self, line: int, word: str, why: str, hint: str) -> ProgramError:
        """The error of what a language cannot say."""
        return ProgramError(
            f"{self.language} cannot say this: {why}", where=f"{self.source}:{line}", value=word, hint=hint
        )

    def origin(self) -> str:
        """Version that made the program, and its source."""
        plain = "".join(c if 32 <= ord(c) < 127 and c not in "()" else "?" for c in self.source)
        return f"converted by counterflex {__version__} from {plain[:80]}"

    # ---- language --------------------------------------------------------------------------------------------

    @abstractmethod
    def begin(self) -> None:
        """Lines before everything."""

    @abstractmethod
    def end(self) -> dict[str, str]:
        """Files."""

    @abstractmethod
    def comment(self, text: str) -> None:
        """A comment."""

    @abstractmethod
    def process(self, step: MachineFunction) -> None:
        """A machine function. Raises a ProgramError where the language does not have it."""

    @abstractmethod
    def dwell(self, move: Move) -> None:
        """A wait."""

    @abstractmethod
    def straight(self, move: Move, share: float) -> None:
        """A straight motion to a share of a move."""

    @abstractmethod
    def arc_shares(self, move: Move) -> list[float] | None:
        """Shares at which the pieces of a circle end; None where it becomes straight moves."""

    @abstractmethod
    def arc(self, move: Move, start_share: float, end_share: float) -> None:
        """A piece of a circle."""


def _tilted(step: Step) -> bool:
    return isinstance(step, Move) and bool(np.hypot(*step.axis[:2]) > UPRIGHT or step.axis[2] < 0.0)


def turn_deg(move: Move) -> float:
    """Angle of a circle, deg, without sign."""
    return abs(move.motion.turn_rad) / DEG
