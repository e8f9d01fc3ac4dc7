"""A robot program back with only its targets and speeds changed: what every language does the same way."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final, Generic, TypeVar

import numpy as np

from counterflex import __version__
from counterflex.core.arrays import Bool, Float, as_positive
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, UM
from counterflex.geometry import pose, rotation
from counterflex.path.sampling import point_spacing
from counterflex.path.toolpath import FEED
from counterflex.programs.compensated import CompensatedPath, mark
from counterflex.programs.limits import Limits
from counterflex.programs.motion_rows import LEAST_FEED_CHANGE, MotionRows, feed_factor, motion_rows, written_error
from counterflex.programs.program import Motion
from counterflex.programs.robot_text.circle_fit import FittedCircle, fitted_circle
from counterflex.programs.robot_text.program import NamedPoint, RobotProgram
from counterflex.programs.robot_writer.points import FineRows
from counterflex.programs.robot_writer.spaced_points import refined, spaced

_LEVER_M: Final = 0.3  # A turn by 1 rad moves as much as this: the reach of a tool and its holder


def fine_rows(
    rows: MotionRows, compensated: CompensatedPath, tolerance_m: float, cycle_s: float
) -> tuple[MotionRows, Float]:
    """The rows of a path with the points to write among them, and further rows where points need places between.

    Ends of motions and changes of speed stay. Between them a straight line leads from point to point within the
    tolerance at the same place of the way, and points are at least feed times cycle apart (Berger2013 eq. 5); where the
    two contradict, the distance wins.

    Args:
        rows: The compensated path by motion.
        tolerance_m: Largest distance of a commanded row from the written path, m.
        cycle_s: Time the controller needs per point, s.

    Returns:
        The rows, ``vertex`` where a point is written, and (n,) rotation vectors of the correction in part axes, rad.
    """
    path, n = compensated.path, len(compensated.path)
    stays = np.zeros(n, dtype=np.bool_)
    have = rows.last >= 0
    stays[rows.last[have]] = stays[np.maximum(rows.first[have] - 1, 0)] = True
    stays[:1] = True
    stays[:-1] |= rows.share[1:] != rows.share[:-1]
    travel = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rows.command, axis=0), axis=1))])[:n]
    spacing = np.where(path.kind == FEED, point_spacing(1.0, cycle_s) * path.feed_m_s, 0.0)
    pieces = refined(travel, spacing, np.flatnonzero(rows.vertex | stays))
    fine = FineRows(pieces)
    ends = np.cumsum(pieces) - 1
    along, command = fine.between(rows.along), np.ascontiguousarray(fine.between(rows.command))
    rotvec = np.ascontiguousarray(fine.between(compensated.rotvec_part_command))
    chosen = spaced(
        along, command, rotvec, fine.between(travel), spacing[fine.row], fine.at_rows(stays), tolerance_m,
        tolerance_m / _LEVER_M,
    )  # fmt: skip
    vertex = np.zeros(len(along), dtype=np.bool_)
    vertex[chosen] = True
    return (
        replace(
            rows,
            first=np.where(rows.first > 0, ends[np.maximum(rows.first - 1, 0)] + 1, 0),
            last=np.where(have, ends[rows.last], -1),
            nominal=fine.between(rows.nominal),
            command=command,
            shift=fine.between(rows.shift),
            way=fine.between(rows.way),
            vertex=vertex,
            share=rows.share[fine.row],
            along=along,
        ),
        rotvec,
    )


SAME_TURN: Final = 1e-9


@dataclass
class Counts:
    """Counts of what was written."""

    moved_motions: int = 0  # Motions with at least one corrected row
    split_motions: int = 0  # Motions that were written as several
    vertices_added: int = 0  # Points written in addition to those of the source
    arcs_kept: int = 0  # Corrected circles still written as one
    arcs_as_lines: int = 0  # Corrected circles written as straight moves
    speeds_changed: int = 0  # Instructions with another speed than programmed
    speeds_added: int = 0  # Lines that set the speed, in addition to those of the source
    targets_declared: int = 0  # Targets changed where they are declared
    targets_written_out: int = 0  # Targets whose name other places use too, written into the instruction instead
    routines_copied: int = 0  # Routines written once more, because another call of them needs other targets


@dataclass(kw_only=True)
class InPlaceText(Counts):
    """Written files and what became of the program."""

    files: dict[str, str]  # Text by name
    tolerance_m: float  # Allowed distance of the written path from the commanded rows, at the same place of the way
    resolution_m: float  # Last decimal written
    largest_written_error_m: float  # Largest distance of the written path from the commanded rows of feed motions
    largest_dwell_error_m: float  # The same during waits, which keep the position of the motion before them
    warnings: tuple[str, ...] = field(default=())  # What the user should know, one sentence each


P = TypeVar("P", bound=RobotProgram)
N = TypeVar("N", bound=NamedPoint)
CONVERT: Final = "counterflex convert writes the program out, one {} for each motion: compensate that one"


class InPlace(ABC, Generic[P]):
    """Walks through the motions of a program and tells a language what to write.

    Every byte that is no number of a corrected target or of a changed speed stays; nothing at all changes when no row
    is corrected. Where one straight line is not enough, points are added before the target, at least feed times
    ``cycle_s`` apart. A corrected circle stays a circle where the commanded points lie on one within the tolerance,
    else it becomes straight moves. Rapids are corrected at their ends only. Where the speed changes, the instruction
    gets its own.

    Args:
        compensated: Commanded rows for the path sampled from ``program``.
        tolerance_m: Largest distance between a commanded row and the written path at the same share of the motion.
        cycle_s: Time the controller needs per point, s.

    Attributes:
        counts: What became of the program.
    """

    limits: ClassVar[Limits]
    cycle_s: ClassVar[float]
    """Time a controller of this language usually needs per point, s."""

    def __init__(self, program: P, compensated: CompensatedPath, tolerance_m: float, cycle_s: float) -> None:
        turned = compensated.rotvec_part_command
        rows = motion_rows(program, compensated, tolerance_m, (np.zeros_like(turned), turned))
        self.changed = bool(rows.moved.any() or np.any(rows.share != 1.0))  # Any row is corrected
        self.program, self.tolerance_m = program, tolerance_m
        self.decimal_m = 10.0**-self.limits.position_decimals * MM
        self.rows, self.rotvec = fine_rows(rows, compensated, tolerance_m, cycle_s)
        n = len(self.rows.way)
        self.written: Float = np.full((n, 3), np.nan)
        self.checked: Bool = np.zeros(n, dtype=np.bool_)
        self.counts, self.arc_error_m = Counts(), 0.0
        self.p_here: Float = np.zeros(3)  # (3,) m, position that was written last

    @classmethod
    def write(
        cls,
        program: P,
        compensated: CompensatedPath,
        *,
        tolerance_m: float = 5e-6,
        cycle_s: float | None = None,
        cell: str = "",
        job: str = "",
    ) -> InPlaceText:
        """Write a program back with its targets replaced by the commanded ones.

        Args:
            compensated: Commanded rows for the path sampled from ``program``.
            tolerance_m: Largest distance between a commanded row and the written path at the same share of the motion,
                before rounding; > 0, m.
            cycle_s: Time the controller needs per point, s, > 0; None takes the usual one of the language.
            cell: Name of the cell, for the comment at the head.
            job: Hash of the plan, for the same.

        Returns:
            Files and counts; files that do not change are byte for byte as read.

        Raises:
            InputError: Path and program do not belong together, or an option is out of range.
            ProgramError: An instruction is corrected that cannot say it, or that runs more than once where each run
                needs a target of its own.
        """
        as_positive("tolerance_m", tolerance_m)
        writer = cls(
            program, compensated, tolerance_m, as_positive("cycle_s", cls.cycle_s if cycle_s is None else cycle_s)
        )
        if not writer.changed:
            return writer.result(writer.files([]))
        writer.run()
        return writer.result(writer.files(writer.messages(cell, mark(job) if job else "")))

    # ---- language --------------------------------------------------------------------------------------------

    @abstractmethod
    def files(self, messages: list[str]) -> dict[str, str]:
        """Text of each file with its edits, and comments at the head; no messages where nothing changes."""

    def rounded(self, p: Float) -> Float:
        """(3,) m, a position as it is written."""
        out: Float = np.round(p / MM, self.limits.position_decimals) * MM
        return out

    @abstractmethod
    def add(self, index: int, p: Float, R_part_tcp: Float, speed_m_s: float | None, *, exact: bool = False) -> None:
        """Write a straight motion to a point before the instruction of a motion.

        Args:
            p: (3,) m.
            R_part_tcp: (3, 3) orientation of the cell's TCP frame.
            speed_m_s: Speed to it; None where it is the programmed one.
            exact: The robot stops there.
        """

    @abstractmethod
    def end(self, index: int, p: Float, R_part_tcp: Float | None, speed_m_s: float | None) -> Float:
        """Give a motion another end; returns it as it is written, (3,) m. Without ``R_part_tcp`` the tool stays."""

    @abstractmethod
    def circle(self, index: int, fit: FittedCircle) -> None:
        """Give a circle another auxiliary point."""

    @abstractmethod
    def straightened(self, index: int) -> None:
        """Make a straight motion of a circle."""

    def divided(self, index: int) -> None:
        """Refuse to add points before a motion where they cannot stand; they may everywhere, if not said otherwise."""
        del index

    def begun(self, index: int) -> None:
        """A motion begins."""
        del index

    def fixed_turn(self, index: int) -> bool:
        """Return whether the program states the angle of a circle, which then stays."""
        del index
        return False

    # ---- motions ---------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Write every motion."""
        program = self.program
        if len(self.written):
            self.written[0] = self.rows.nominal[0]
        for index, motion in enumerate(program.motions):
            last = int(self.rows.last[index])
            self.begun(index)
            if motion.kind == "dwell":
                self._relieve(index)
            elif motion.kind == "arc":
                self._arc(index)
            else:
                self._straight(index)
            if last >= 0:
                self.written[last] = self.p_here
                self.checked[last] |= motion.kind != "arc"

    def _straight(self, index: int) -> None:
        motion, rows = self.program.motions[index], self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        before = first - 1
        if motion.kind == "feed" and rows.moved[index] and last > first:
            before = self._added(index)
        self._end(index, before)
        if motion.kind == "feed" and last >= 0:
            self.checked[first : last + 1] = True

    def _added(self, index: int) -> int:
        """Points before the end of a motion; the row of the last one."""
        rows = self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        steps = (np.flatnonzero(rows.vertex[first:last]) + first).tolist()
        if steps:
            self.divided(index)
        before = first - 1
        for row in steps:
            p = self.rounded(rows.command[row])
            self.add(index, p, self.orientation(index, row), self._speed(index, before, row))
            self.p_here = self.written[row] = p
            before = row
        self.counts.vertices_added += len(steps)
        self.counts.split_motions += bool(steps)
        return before

    def _end(self, index: int, before: int, fit: FittedCircle | None = None) -> None:
        """A motion's own target."""
        motion, last = self.program.motions[index], int(self.rows.last[index])
        p = np.asarray(motion.p_end) if last < 0 else self.rows.command[last]
        p = p if fit is None else fit.end()
        turned = last >= 0 and bool(np.any(np.abs(self.rotvec[last]) > SAME_TURN))
        R = self.orientation(index, last) if turned else None
        self.p_here = self.end(index, p, R, self._speed(index, before, last))

    def _relieve(self, index: int) -> None:
        """Before a wait, go to where it is planned; that lies along the tool axis."""
        rows = self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        if last < 1 or not np.any(rows.command[last] != rows.command[first - 1]):
            return
        p = self.rounded(rows.command[last])
        self.add(index, p, self.orientation(index, last), None, exact=True)
        self.p_here = p
        self.counts.vertices_added += 1

    def _arc(self, index: int) -> None:
        motion, rows = self.program.motions[index], self.rows
        first, last = int(rows.first[index]), int(rows.last[index])
        if not rows.moved[index] and float(np.linalg.norm(self.p_here - motion.p_start)) <= 0.5 * self.decimal_m:
            self._end(index, first - 1)
            return
        points = np.vstack([self.p_here, rows.command[first : last + 1]])
        nominal = rows.nominal[first : last + 1]
        fit = fitted_circle(motion, points, nominal, fixed_turn=self.fixed_turn(index))
        steady = float(np.ptp(rows.share[first : last + 1])) <= LEAST_FEED_CHANGE
        if fit is not None and fit.error_m <= self.tolerance_m and steady:
            self.circle(index, fit)
            self._end(index, first - 1, fit)
            self.arc_error_m = max(self.arc_error_m, fit.error_m)
            self.counts.arcs_kept += 1
            return
        before = self._added(index)
        self.straightened(index)
        self._end(index, before)
        self.checked[first : last + 1] = True
        self.counts.arcs_as_lines += 1

    # ---- values ----------------------------------------------------------------------------------------------

    def orientation(self, index: int, row: int) -> Float:
        """(3, 3) commanded orientation of the cell's TCP frame at a row of a motion."""
        rows, Rs = self.rows, self.program.Rs_part_tcp
        if Rs is None:
            raise ValueError("a program without orientations")
        first, last = int(rows.first[index]), int(rows.last[index])
        length = rows.along[last] - rows.along[first - 1]
        share = (rows.along[row] - rows.along[first - 1]) / length if length > 0.0 else 1.0
        end: Float = Rs[index]
        if share < 1.0 and index > 0:
            start = Rs[index - 1]
            end = start @ rotation.exp(float(share) * rotation.log(start.T @ end))
        out: Float = rotation.exp(self.rotvec[row]) @ end
        return out

    def _speed(self, index: int, before: int, row: int) -> float | None:
        """Speed for the piece that ends at a row, m/s; None where it is the programmed one."""
        # The loaded tool covers the nominal piece while the controller runs along the commanded one, so the programmed
        # speed is multiplied by commanded over nominal length, and by the share that the plan leaves of it.
        motion: Motion = self.program.motions[index]
        rows = self.rows
        if motion.feed_m_s <= 0.0 or row < 0 or not rows.moved[index]:
            return None
        travel = np.linalg.norm(np.diff(rows.command[before : row + 1], axis=0), axis=1).sum()
        nominal = rows.way[row] - rows.way[before]
        factor = float(feed_factor(np.array([nominal]), np.array([travel]))[0]) * rows.share_of(before + 1, row)
        if abs(factor - 1.0) <= LEAST_FEED_CHANGE:
            return None
        return motion.feed_m_s * factor

    def result(self, files: dict[str, str]) -> InPlaceText:
        """Figures of what was written."""
        error = max(written_error(self.rows, self.written, self.checked), self.arc_error_m)
        warnings = []
        if error > self.tolerance_m + self.decimal_m:
            warnings.append(
                f"the written path is up to {error / UM:.1f} um from the planned one (tolerance "
                f"{self.tolerance_m / UM:g} um): the points would have to be closer together than feed times "
                "controller cycle. A lower feed or the real controller.cycle_ms helps"
            )
        return InPlaceText(
            **vars(replace(self.counts, moved_motions=int(self.rows.moved.sum()))),
            files=files,
            tolerance_m=self.tolerance_m,
            resolution_m=self.decimal_m,
            largest_written_error_m=error,
            largest_dwell_error_m=self.rows.dwell_error_m,
            warnings=tuple(warnings),
        )

    def messages(self, cell: str, job: str) -> list[str]:
        """Comments that say what made the program, in which cell, for which job."""
        out = [f"made by counterflex {__version__} from {plain(self.program.name)}"]
        out += [f"compensated targets, path tolerance {self.tolerance_m / MM:.4f} mm"]
        out += [f"cell {plain(cell)}"] if cell else []
        return [*out, *([job] if job else [])]


class PointsInPlace(InPlace[P], Generic[P, N]):
    """Languages whose instructions name a point that stands elsewhere: changed there once, or an entry of its own."""

    statement: ClassVar[str] = "instruction"  # What the language calls an instruction

    def __init__(self, program: P, compensated: CompensatedPath, tolerance_m: float, cycle_s: float) -> None:
        super().__init__(program, compensated, tolerance_m, cycle_s)
        self.points: list[N] = self.points_of(program)  # The point that each motion leads to
        self._again = Counter((point.file, point.start) for point in self.points if point.moves)

    @abstractmethod
    def points_of(self, program: P) -> list[N]:
        """Return the point that each motion leads to."""

    @abstractmethod
    def literal(self, point: N, T_frame_tool: Float, *, turned: bool) -> Float | None:
        """Change the entry that a point names; returns its place as it is written, (3,) m; None where it names none."""

    @abstractmethod
    def write_out(self, point: N, T_frame_tool: Float) -> None:
        """Give a point that is computed an entry of its own."""

    @abstractmethod
    def shown(self, point: N) -> str:
        """Text of the instruction of a point, for errors."""

    def place(self, point: N) -> str:
        """Return where an instruction stands, for errors."""
        return f"{point.file}:{point.line}"

    def refusal(self, point: N, what: str, hint: str = "", **data: bool) -> ProgramError:
        """Return the error of a point that is not written back."""
        return ProgramError(what, where=self.place(point), value=" ".join(self.shown(point).split())[:60],
                            hint=hint or CONVERT.format(self.statement), **data)  # fmt: skip

    def refuse_repeated(self, point: N) -> None:
        """Refuse to change an instruction that runs more than once: each run has a correction of its own."""
        if self._again[point.file, point.start] > 1:
            article = "an" if self.statement[0] in "aeiou" else "a"
            what = f"{article} {self.statement} that runs more than once is corrected, and is not written back"
            raise self.refusal(point, what, each_pass=True)

    def like(self, index: int) -> N:
        """The point that an added one is like: that of the motion, of a wait the one before."""
        return next(self.points[i] for i in range(index, -1, -1) if self.points[i].T_frame_tool is not None)

    def moved(self, before: Float, p: Float, R_part_tcp: Float | None) -> bool:
        """Return whether a place, (3,) m, differs from that before by what is written, or the orientation is new."""
        return R_part_tcp is not None or float(np.abs(p - before).max()) > 0.5 * self.decimal_m

    def end_at(self, point: N, p: Float, R_part_tcp: Float | None) -> Float:
        """Give a point another place; returns it as it is written, (3,) m."""
        old = point.T_part_tool
        R = old[:3, :3] if R_part_tcp is None else R_part_tcp @ point.R_tcp_tool
        T = pose.inverse(point.T_part_frame) @ pose.make(R, p)
        written = self.literal(point, T, turned=R_part_tcp is not None)
        if written is not None:
            return written
        if not point.relative and not self.moved(old[:3, 3], p, R_part_tcp):
            unchanged: Float = old[:3, 3]
            return unchanged
        self.refuse_repeated(point)
        self.write_out(point, T)
        self.counts.targets_written_out += 1
        return self.rounded(p)


def near_angles(angles: Any, near: Float, decimals: int | None = None) -> Float:
    """(3,) three Euler angles of the same orientation in deg, in +-180, near others; rounded before, if at all."""
    first, second, third = angles
    ways = [np.array([first, second, third]), np.array([first + 180.0, 180.0 - second, third + 180.0])]
    ways = [way - 360.0 * np.round((way - near) / 360.0) for way in ways]
    best = min(ways, key=lambda way: float(np.abs(way - near).max()))
    best = best if decimals is None else np.round(best, decimals)
    out: Float = np.where(np.abs(best) > 180.0, best - 360.0 * np.sign(best), best)
    return out


def plain(text: str) -> str:
    """Text for a comment: printable ASCII, 120 characters at most."""
    return "".join(c if 32 <= ord(c) < 127 else "?" for c in text)[:120]
