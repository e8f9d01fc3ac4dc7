"""A program of a machine back with only its targets changed: what G-code, APT and Klartext do the same way."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Bool, Float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import INCH, MM
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.motion_rows import motion_rows, written_error
from counterflex.programs.program import Program
from counterflex.programs.rotary.poses import CommandedWords


@dataclass(frozen=True)
class GcodeText:
    """A written program and what became of it."""

    text: str  # The program, with the line ends of the source
    moved_motions: int  # Motions with at least one corrected row
    split_motions: int  # Motions that were written as several blocks
    vertices_added: int  # Blocks written in addition to those of the source
    arcs_kept: int  # Corrected arcs still written as one arc
    arcs_split: int  # Corrected arcs written as several arcs, or partly as arcs
    arcs_as_lines: int  # Corrected arcs written as straight moves only
    radius_replaced: int  # Arcs given by R in the source that needed I, J, K
    # Uncorrected blocks that had to be edited because they inherited a corrected position or another motion word
    completed_blocks: int
    cycles_expanded: int  # Canned-cycle blocks written as single moves
    unrolled: bool  # True when loops, calls and expressions were replaced by what they execute
    tolerance_m: float  # Allowed distance of the written path from the commanded samples, at the same place of the way
    resolution_m: float  # Last decimal written
    # Largest distance of the written path from the commanded samples of feed motions (rapids count at their ends only);
    # at most ``tolerance_m`` plus one rounding, 0.87 ``resolution_m``
    largest_written_error_m: float
    # Largest distance of the commanded from the written position during dwells: a dwell keeps the position of the
    # motion before it
    largest_dwell_error_m: float
    # Largest correction of orientation, which G-code without rotary axes cannot say
    largest_dropped_rotation_rad: float


class MachineInPlace(ABC):
    """Writes a program statement by statement; the language edits and adds lines.

    Args:
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Bound for straight pieces and arcs.
        decimals: Of written coordinates in mm; inch programs get one more.
        words: Of a program that turns the tool, what to command; ``compensated`` is not asked then.

    Attributes:
        dropped_rad: Largest correction of orientation that was not written.
    """

    own_decimals: ClassVar[int] = 4
    """Decimals of coordinates in mm where nothing else is asked for."""
    unrolls: ClassVar[bool] = True
    """A program with loops or calls is written in the order of execution."""
    split_motions = vertices_added = arcs_kept = arcs_split = arcs_as_lines = 0
    radius_replaced = completed_blocks = cycles_expanded = 0

    def __init__(
        self,
        program: Program,
        compensated: CompensatedPath,
        tolerance_m: float,
        decimals: int,
        words: CommandedWords | None,
    ) -> None:
        angles = None
        if words is not None:
            compensated = CompensatedPath(words.path, words.p_command, np.zeros_like(words.p_command))
            angles = (words.angle_rad, words.angle_command_rad)
        self.program, self.tolerance_m, self._angles = program, tolerance_m, angles
        self.rows = motion_rows(program, compensated, tolerance_m, angles)  # The compensated path by motion
        self.changed = bool(self.rows.moved.any() or np.any(self.rows.share != 1.0))  # Any row is corrected
        self._decimals = decimals
        self._unit_m = self.unit_m(program)
        self._digits = decimals + (self._unit_m == INCH)
        self.resolution_m = self._unit_m * 10.0**-self._digits  # Last decimal written
        self.lines: list[str] = []  # Written so far
        # (rows, 3) m, where the written program is at each row; NaN where no written point stands for it
        self.written: Float = np.full((len(self.rows.way), 3), np.nan)
        # Rows at which the written path is compared with the commanded one
        self.checked: Bool = np.zeros(len(self.rows.way), dtype=np.bool_)
        self.arc_error_m = self.dropped_rad = 0.0
        self.prepare()

    @abstractmethod
    def prepare(self) -> None:
        """Set what the language keeps while it writes."""

    @staticmethod
    def unit_m(program: Program) -> float:
        """Unit of the coordinates, m."""
        return min((block.modal.unit_m for block in program.blocks if block.motion_count), default=MM)

    @abstractmethod
    def run(self) -> list[str]:
        """All lines of the written program."""

    @abstractmethod
    def put_head(self, lines: list[str], texts: list[str]) -> None:
        """Put comments at the head of the written lines."""

    def count_split(self, added: int) -> None:
        """Count a straight motion that became more blocks by this many."""
        self.split_motions += added > 0
        self.vertices_added += added

    def count_arc(self, arcs: list[bool]) -> None:
        """Count the pieces of an arc: by piece, whether it is an arc."""
        self.arcs_kept += arcs == [True]
        self.arcs_split += len(arcs) > 1 and any(arcs)
        self.arcs_as_lines += not any(arcs)
        self.count_split(len(arcs) - 1)

    @classmethod
    def write(
        cls,
        program: Program,
        compensated: CompensatedPath,
        *,
        tolerance_m: float = 5e-6,
        decimals: int | None = None,
        cell: str = "",
        header: bool = True,
        job: str = "",
        words: CommandedWords | None = None,
    ) -> GcodeText:
        """Write a program back with its targets replaced by the commanded ones.

        Statements whose motions are not corrected stay byte for byte, but for words that they would inherit from what
        is corrected: these are written. Corrected straight moves get their words edited in place and further ones where
        one straight line is not enough; corrected arcs stay arcs where the commanded points lie on one within the
        tolerance, else they become several arcs or straight moves. Rapids are corrected at their end points only,
        dwells keep the position of the motion before them. Nothing at all changes when no row is corrected.

        Args:
            compensated: Commanded rows for the path sampled from ``program``.
            tolerance_m: Largest distance between a commanded sample and the written path at the same place of the way
                (the same share of the motion's length), before rounding; > 0, m.
            decimals: Decimals of written words in mm programs, 2 to 6, None the usual ones; inch programs get one more.
            cell: Name of the cell, for the header comment.
            header: Write a comment that says what made the program; never written when nothing changed.
            job: Hash of the plan, for the header comment: :func:`counterflex.plan.plan.job_hash`.
            words: Of a program that turns the tool, the words to command; ``compensated`` is not asked then.

        Raises:
            InputError: Path and program do not belong together, or an option is out of range.
            ProgramError: A corrected statement cannot be written (its words do not lead to its target).
        """
        as_positive("tolerance_m", tolerance_m)
        decimals = cls.own_decimals if decimals is None else decimals
        if not 2 <= decimals <= 6:
            raise InputError("decimals is out of range", value=decimals, limit="2 .. 6")
        writer = cls(program, compensated, tolerance_m, decimals, words)
        changed, rows = writer.changed, writer.rows
        lines = writer.run() if changed else list(program.lines)
        if changed and header:
            writer.put_head(lines, header_lines(program, tolerance_m, cell, job))
        dropped = float(np.max(np.linalg.norm(compensated.rotvec_part_command, axis=1), initial=0.0))
        error = max(written_error(rows, writer.written, writer.checked), writer.arc_error_m) if changed else 0.0
        own: dict[str, Any] = {
            "text": program.newline.join(lines),
            "moved_motions": int(rows.moved.sum()) if changed else 0,
            "unrolled": changed and writer.unrolls and not program.straight,
            "largest_written_error_m": error,
            "largest_dwell_error_m": rows.dwell_error_m,
            "largest_dropped_rotation_rad": max(writer.dropped_rad, dropped if words is None else words.dropped_rad),
        }
        names = [field.name for field in fields(GcodeText)]
        return GcodeText(**{name: own[name] if name in own else getattr(writer, name) for name in names})


def header_lines(program: Program, tolerance_m: float, cell: str, job: str) -> list[str]:
    """Text of the comments that say what made a program."""
    lines = [
        f"made by counterflex {__version__} from {_plain(program.name)}",
        f"compensated targets, path tolerance {tolerance_m / MM:.4f} mm{', cell ' + _plain(cell) if cell else ''}",
    ]
    lines += [mark(job)] if job else []
    return [
        *lines,
        *([] if program.straight else ["loops, calls and expressions written out in the order of execution"]),
    ]


def _plain(text: str) -> str:
    return "".join(c for c in text if 32 <= ord(c) < 127 and c not in "()%;")[:120]
