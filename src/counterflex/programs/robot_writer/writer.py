"""Writing a robot program: what KRL and RAPID share. A language adds its words and its files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, Generic, Protocol, TypeVar

from counterflex import __version__
from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.path.toolpath import ToolPath
from counterflex.programs.compensated import mark
from counterflex.programs.language import StatementForms
from counterflex.programs.program import Block, Program
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.programs.robot_writer.points import (
    BlockLines,
    RobotPoints,
    RobotText,
    carried_text,
    choose_points,
    event_motions,
    steps,
    stops,
)

_CHANGES: Final = (6.0, 61.0)


class RobotLanguage(Protocol):
    """Words of a language that a part needs."""

    def block(self, block: Block) -> list[str]:
        """Lines for what a block does beside moving, its comment included."""

    def dwell(self, time_s: float) -> str:
        """Line that waits."""

    def point(self, index: int) -> list[str]:
        """Lines that lead to a point."""

    def enter(self, tool: int, place: int) -> list[str]:
        """Lines behind a change of tool: its frame, and the way back to the point at which it was changed."""


@dataclass
class RobotParts:
    """Lines of a robot program.

    What stands before the first point and behind the last one belongs to the main file also where the path is cut into
    parts: there nothing moves, and a person may be asked for something.
    """

    # Lines before the move to the start posture: they end with the first change of tool, so that the robot goes there
    # with the tool that it works with
    lead: list[str] = field(default_factory=list)
    opening: list[str] = field(default_factory=list)  # Lines between that move and the first point
    # Lines of each part, in order, from its first point to its last; a change of tool begins one
    parts: list[list[str]] = field(default_factory=lambda: [[]])
    ending: list[str] = field(default_factory=list)  # Lines behind the last point
    changes: int = 0  # Number of parts that begin with a change of tool

    def warnings(self, points_per_file: int) -> tuple[str, ...]:
        """Warnings about the cut into parts."""
        if len(self.parts) == 1:
            return ()
        tools = f", {self.changes} of them for a change of tool" if self.changes else ""
        return (f"split into {len(self.parts)} parts of at most {points_per_file} points{tools}",)


def first_tool(program: Program) -> int:
    """Number of the tool that the first motion with a tool is made with; 0 where there is none."""
    return next((motion.tool for motion in program.motions if motion.tool), 0)


def changes_tool(block: Block) -> bool:
    """Return whether a block puts a tool into the spindle, or takes it out (T0)."""
    return any(word.letter == "M" and word.value in _CHANGES for word in block.words)


def robot_parts(program: Program, points: RobotPoints, language: RobotLanguage, points_per_file: int) -> RobotParts:
    """Cut a program into parts.

    Args:
        language: How a block, a dwell, a point and a change of tool are said.
        points_per_file: Largest number of points of a part.
    """
    out = RobotParts()
    count, place, moved = 0, -1, 0
    tool, last = first_tool(program), len(points.row) - 1
    for step in steps(program, points):
        if isinstance(step, Block):
            lines = language.block(step)
            changes = changes_tool(step)
            tool = step.modal.tool or tool  # an empty spindle is led as the last tool was
            if changes and place < 0:
                out.lead += [*out.parts[-1], *lines]
                out.parts[-1] = []
            elif not changes or place == last:  # behind the last point nothing has to be led back
                out.parts[-1] += lines
            else:
                out.parts.append([*lines, *language.enter(tool, place)])
                out.changes += 1
                count, moved = 0, len(out.parts[-1])
        elif isinstance(step, float):
            out.parts[-1].append(language.dwell(step))
        else:
            if place < 0:
                out.opening, out.parts[-1] = out.parts[-1], []
            if count == points_per_file:
                out.parts.append([])
                count = 0
            count += 1
            place = step
            out.parts[-1] += language.point(step)
            moved = len(out.parts[-1])
    out.ending = out.parts[-1][moved:]
    del out.parts[-1][moved:]
    return out


@dataclass(frozen=True, kw_only=True)
class RobotSettings:
    """Settings of a robot program beside its path, common to all languages."""

    name: str  # Program name; where the program is split, a part adds four characters to it
    # (6,) axes of the posture the program starts from, as the controller shows them, rad
    start_axes_rad: Sequence[float]
    rapid_m_s: float = 0.2  # Speed of rapids, m/s
    orientation_deg_s: float = 100.0  # Reorientation speed, deg/s
    cycle_s: float  # Time the controller needs per point, s
    points_per_file: int  # Motion instructions in one file; longer programs are split and called by a master
    cell: str = ""  # Name of the cell, for the header
    job: str = ""  # Hash of the plan, for the header
    # What the controller calls the tool frame, by number of the tool in the program
    tool_data: Mapping[int, Any] = field(default_factory=dict)
    # Value of external axis 1 to 6 by its number, mm or deg: where it stands at the begin
    external_axes: Mapping[int, float] = field(default_factory=dict)
    # The same for each place that they take along the program; empty: they stand all along
    places: Sequence[Mapping[int, float]] = ()
    # Numbers of external axes that turn: their values are deg, those of others mm
    turning_axes: frozenset[int] = frozenset()

    def check(self) -> None:
        """Check ranges. Raises InputError: a setting is out of range."""
        as_float("start_axes_rad", self.start_axes_rad, (6,))
        for key in ("rapid_m_s", "orientation_deg_s", "cycle_s"):
            as_positive(key, getattr(self, key))
        if self.points_per_file < 1:
            raise InputError("points_per_file is out of range", value=self.points_per_file, limit=">= 1")


S = TypeVar("S", bound=RobotSettings)
Poses = Sequence[Float]
External = Mapping[int, float] | None


class RobotWords(ABC, Generic[S]):
    """Words of a language, which commanded paths and converted programs are written with alike."""

    language: ClassVar[str]
    sign: ClassVar[str]
    """Begins a comment."""
    stop: ClassVar[str]
    """Waits for a person (M0)."""
    settings: S  # Names, frames, speeds
    tool: int  # Number of the tool in the spindle

    @property
    def wait(self) -> str:
        """Line of a dwell, with ``{}`` for its time in s; that of a pause too: a dwell is read back, a pause is not."""
        return StatementForms.of(self.language).pause

    @abstractmethod
    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """Files of a program by name: the main one, or a part that it calls."""

    @abstractmethod
    def call(self, part: str) -> str:
        """Line that runs a part."""

    def frames(self, tool: int) -> list[str]:
        """Lines that set the frames of a tool, where motions do not name them."""
        del tool
        return []

    @abstractmethod
    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """Lines of a motion: straight to a pose, or on a circle through one pose to another.

        Args:
            Ts_part_tcp: (4, 4) m, one pose or two.
            speed_m_s: Along the path, m/s.
            exact: The robot stops at the end.
            free: The robot takes its own way, by its axes.
            external: Values of the external axes at the end, mm or deg; None: as at the begin.
        """


def require_language(words: str, dialect: str) -> None:
    """Refuse words of another language: their pause would be written. Raises InputError."""
    if words != dialect:
        raise InputError("the writer has words of another language", value=words, limit=dialect)


class RobotWriter(RobotWords[S], Generic[S]):
    """Writes a commanded path as a robot program in the part frame, with a linear motion to every point.

    Speeds follow the programmed feed. Spindle, coolant and tool change are what ``block_lines`` says, M0 and M1 stop
    the program, dwells wait; the text of such blocks is carried beside them as a comment. The first change of tool
    comes before the move to the start; every other one begins a part (a file) with a tool frame of its own, which
    first goes back to where the tool was changed.

    Args:
        program: The program the path was sampled from (its comments and M-codes are carried along).
        path: Nominal rows.
        Ts_part_tcp: (n, 4, 4) commanded poses of the tool frame (z out of the spindle) in the part frame, m.
        settings: Names, frames, speeds.
        tolerance_m: Largest distance of a commanded row from the written polyline before merging, m.
        tolerance_rad: The same for the orientation, rad.
        block_lines: Lines of the language for a block (spindle, coolant, tool change):
            :meth:`counterflex.programs.robot_writer.machine_functions.MachineFunctions.lines`. When left out, none is
            known.

    Raises:
        InputError: A setting is out of range or the poses do not fit the path.
        ProgramError: A block needs lines that are not known.
    """

    def __init__(
        self,
        program: Program,
        path: ToolPath,
        Ts_part_tcp: Float,
        settings: S,
        *,
        tolerance_m: float = 1e-5,
        tolerance_rad: float = 1e-4,
        block_lines: BlockLines | None = None,
    ) -> None:
        settings.check()
        self.original, self.settings, self.tolerance_m = program, settings, tolerance_m
        self.first_tool = self.tool = first_tool(program)
        self.speed: float | None = None  # Speed that was last set, m/s; None where none was
        self.block_lines = block_lines or MachineFunctions(self.language).lines
        self.points = choose_points(
            program,
            path,
            Ts_part_tcp,
            tolerance_m=tolerance_m,
            tolerance_rad=tolerance_rad,
            cycle_s=settings.cycle_s,
            rapid_m_s=settings.rapid_m_s,
            events=event_motions(program, self.block_lines),
        )

    def text(self) -> RobotText:
        """Files and figures."""
        program, settings, points = self.original, self.settings, self.points
        parts = robot_parts(program, points, self, settings.points_per_file)
        split = len(parts.parts) > 1
        names = [f"{settings.name}_{i:03d}" for i in range(1, len(parts.parts) + 1)] if split else []
        path = [self.call(part) for part in names] if split else parts.parts[0]
        main = [*self.start(parts.lead), *parts.opening, *path, *parts.ending, *self.finish()]
        files = self.program(settings.name, main)
        for part, content in zip(names, parts.parts, strict=False):
            files |= self.program(part, content)
        data = self.data(list(files))
        return RobotText(
            files={name: text for name, text in files.items() if name not in data} | data,
            points=len(points.row),
            merged_points=points.merged,
            too_close=points.too_close,
            largest_position_error_m=points.largest_position_error_m,
            largest_angle_error_rad=points.largest_angle_error_rad,
            largest_position_error_line=points.line(program),
            warnings=(*points.warnings(program, self.tolerance_m), *parts.warnings(settings.points_per_file)),
        )

    def origin(self) -> list[str]:
        """Comments: what made the program, from what, in which cell, for which job."""
        settings = self.settings
        messages = [f"made by counterflex {__version__} from {_plain(self.original.name)}"]
        messages += [f"cell {_plain(settings.cell)}"] if settings.cell else []
        messages += [mark(settings.job)] if settings.job else []
        return [f"{self.sign} {line}" for line in messages]

    def block(self, block: Block) -> list[str]:
        """Lines for what a block does beside moving, its comment included."""
        text = carried_text(block)
        lines = [f"{self.sign} {text}"] if text else []
        return [*lines, *self.block_lines(block), *([self.stop] if stops(block) else [])]

    def dwell(self, time_s: float) -> str:
        """Line that waits."""
        return self.wait.format(f"{time_s:.3f}")

    def external_at(self, index: int) -> Mapping[int, float]:
        """Values of the external axes at a point, by number."""
        places = self.settings.places
        return places[int(self.points.place[index])] if places else self.settings.external_axes

    def speed_to(self, index: int) -> float:
        """Speed to a point, m/s; that of the point before where its own is zero."""
        now = float(self.points.speed_m_s[index])
        self.speed = now if now > 0.0 else self.speed or self.settings.rapid_m_s
        return self.speed

    def point(self, index: int) -> list[str]:
        """Lines that lead to a point."""
        return self._motion_to(index, self.speed_to(index), exact=bool(self.points.exact[index]) or index == 0)

    def enter(self, tool: int, place: int) -> list[str]:
        """Lines behind a change of tool: its frame, and the way back to the point at which it was changed."""
        self.speed, self.tool = self.settings.rapid_m_s, tool
        return [*self.frames(tool), *self._motion_to(place, self.speed, exact=True)]

    def _motion_to(self, index: int, speed_m_s: float, *, exact: bool) -> list[str]:
        return self.motion([self.points.Ts_part_tcp[index]], speed_m_s, exact=exact, external=self.external_at(index))

    @abstractmethod
    def start(self, lead: Sequence[str]) -> list[str]:
        """Lines of the main routine up to the start posture, with those of the first change of tool in them."""

    def finish(self) -> list[str]:
        """Lines at the end of the main routine that put back what the program changed for itself."""
        return []

    def data(self, files: list[str]) -> dict[str, str]:
        """Files beside the programs, by name; ``files`` are those of the programs."""
        del files
        return {}


def _plain(text: str) -> str:
    return "".join(c if 32 <= ord(c) < 127 else "?" for c in text)[:120]
