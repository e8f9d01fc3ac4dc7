"""INFORM: a compensated path as MOVL with positions in a user frame, in relative jobs (JBI)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.integrations.yaskawa.language import LIMITS
from counterflex.integrations.yaskawa.language.program import (
    USER,
    Header,
    comments,
    frame_of,
    job_text,
    numbers_text,
    speed_text,
    values_of,
)
from counterflex.programs.limits import check_name
from counterflex.programs.robot_writer.writer import External, Poses, RobotSettings, RobotWords, RobotWriter

_POSE: Final = "\0"
"""Stands between an instruction and the entry of its position until the positions of a job are numbered."""
_FLAG: Final = "\1"  # Stands between what an entry is under and its numbers
PLAIN: Final = "1,0,0,0,0,0"
"""RCONF of a posture that nothing is known of: no flip, upper arm, front, no turns."""
_UNUSED: Final = ",0" * 18


@dataclass(frozen=True, kw_only=True)
class InformSettings(RobotSettings):
    """Settings of a job beside those of every language; names have up to 32 characters."""

    tool: int = 1  # Tool file of tools that ``tool_data`` does not name
    base: int = 1  # User frame that is the part frame
    # Returns RCONF of a tool pose (4, 4) m in the part frame, six flags with commas between
    configuration: Callable[[Float], str] = lambda _T: PLAIN
    axis_percent: float = 10.0  # Speed of MOVJ, per cent, 0.01 to 100
    cycle_s: float = 0.004
    points_per_file: int = LIMITS.points_per_file
    tool_data: Mapping[int, int] = field(default_factory=dict)  # Tool file by number of the tool in the program
    # (4, 4) m, what the user frame must be on the controller, stated as a comment; None states nothing
    T_world_part: Float | None = None
    T_flange_tcp: Float | None = None  # (4, 4) m, likewise of the first tool

    def check(self) -> None:
        """Check ranges. Raises InputError: a setting is out of range."""
        check_name(self.name, LIMITS, "INFORM")
        super().check()
        if not 0.01 <= self.axis_percent <= 100.0:
            raise InputError("axis_percent is out of range", value=self.axis_percent, limit="0.01 to 100")
        if self.places or self.external_axes:
            raise InputError("external axes have no words in jobs written anew", value="external_axes",
                             hint="Write the job of a cell without [[external_axes]]")  # fmt: skip

    def tool_of(self, tool: int) -> int:
        """Return the tool file of a tool of the program."""
        return self.tool_data.get(tool, self.tool)


def inform_motion(settings: InformSettings, tool: int, word: str, T_part_tcp: Float, rest: str) -> str:
    """Return a motion with the entry of its position, until :func:`inform_job` numbers it.

    Args:
        settings: Frames and configuration.
        tool: Number of the tool in the program.
        word: ``MOVL``, ``MOVJ`` or ``MOVC``.
        T_part_tcp: (4, 4) m.
        rest: Speed and options, as written.
    """
    flags = settings.configuration(T_part_tcp)
    numbers = ",".join(numbers_text(values_of(T_part_tcp)))
    return f"{word} C# {rest}{_POSE}{settings.tool_of(tool)}{_FLAG}{flags}{_FLAG}{numbers}"


def inform_job(name: str, base: int, lines: Sequence[str]) -> str:
    """Return the text of a job: positions numbered and listed, comments cut."""
    entries: list[tuple[Header, str]] = []
    out: list[str] = []
    for line in lines:
        text = line.strip()
        if text.startswith("'"):
            out += [f"'{part}" for part in comments([text[1:].strip()])]
            continue
        form, _, entry = text.partition(_POSE)
        if entry:
            tool, flags, numbers = entry.split(_FLAG)
            form = form.replace("C#", f"C{len(entries):05d}", 1)
            entries.append((Header(USER, base, int(tool), f"{flags}{_UNUSED}"), numbers))
        out.append(form)
    return job_text(name, Header(USER, base), entries, out)


class InformWords(RobotWords[InformSettings]):
    """Jobs."""

    language, sign, stop = "inform", "'", "PAUSE"

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One job."""
        check_name(name, LIMITS, "INFORM")
        return {f"{name}.JBI": inform_job(name, self.settings.base, lines)}

    def call(self, part: str) -> str:
        """CALL."""
        return f"CALL JOB:{part.upper()}"

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """MOVJ or MOVL with a position of its own in the user frame, PL=0 where it must be reached."""
        del external
        (T,) = Ts_part_tcp
        word, speed = (
            ("MOVJ", f"VJ={self.settings.axis_percent:.2f}") if free else ("MOVL", f"V={speed_text(speed_m_s)}")
        )
        return [inform_motion(self.settings, self.tool, word, T, f"{speed}{' PL=0' if exact else ''}")]


class InformWriter(InformWords, RobotWriter[InformSettings]):
    """A commanded path as a job."""

    def dwell(self, time_s: float) -> str:
        """Line that waits; TIMER takes 0.01 s."""
        return self.wait.format(f"{time_s:.2f}")

    def start(self, lead: Sequence[str]) -> list[str]:
        """Return origin, frames on the controller, first tool; by axes to the first point."""
        to_first: list[str] = []
        if len(self.points.row):
            self.tool = self.first_tool
            to_first = self.motion([self.points.Ts_part_tcp[0]], 0.0, exact=True, free=True)
        return [*self.origin(), *self._stated(), *lead, *to_first]

    def _stated(self) -> list[str]:
        """Comments of what the frames, which the job names by number, must be on the controller."""
        settings, out = self.settings, []
        for name, T in (
            (f"UF#({settings.base}) in the robot frame", settings.T_world_part),
            (f"TOOL {settings.tool_of(self.first_tool)}", settings.T_flange_tcp),
        ):
            if T is not None:
                texts = numbers_text(values_of(T))
                out += [f"' {name}", f"' X Y Z {' '.join(texts[:3])}", f"' RXYZ {' '.join(texts[3:])}"]
        return out


def written_pose(T_part_tcp: Float) -> Float:
    """Return (4, 4) m, a pose as a job holds it: rounded to its decimals."""
    return frame_of([float(text) for text in numbers_text(values_of(T_part_tcp))])
