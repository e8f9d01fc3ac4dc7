"""VAL3 programs of a cell: what a program is held against, what is written for one, and what must be set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from counterflex.app.compensation.languages import WritingOrder, Written, robot_text, writer_settings
from counterflex.app.compensation.next_steps import against_fixed_tool, tool_frames
from counterflex.app.compensation.robot_program import tool_data
from counterflex.app.conversion import emitter_settings
from counterflex.app.robot_axes import part_in_world, pose_text
from counterflex.app.robot_programs import refuse_held_part, shared_facts
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.files.cell.cell import Cell
from counterflex.integrations.staubli.language import LIMITS
from counterflex.integrations.staubli.language.program import LETTERS, rotations_of
from counterflex.integrations.staubli.language.read.motions import Val3Cell
from counterflex.programs.convert.emitter import Conversion
from counterflex.programs.convert.robot_languages import RobotEmitter
from counterflex.programs.convert.steps import Move
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import check_name
from counterflex.programs.program import Program
from counterflex.programs.robot_writer.writer import External, Poses, RobotSettings, RobotWords, RobotWriter
from counterflex.report.data import Fact
from counterflex.robot.kinematics.inverse_seeds import branch_of

_XML = '<?xml version="1.0" encoding="utf-8"?>'
_ENTRIES = ("start", "stop")  # Programs that a controller calls in every application
_SCHEMA = "http://www.staubli.com/robotics/VAL3"


@dataclass(frozen=True, kw_only=True)
class Val3Settings(RobotSettings):
    """Settings of a VAL3 application beside those of every language."""

    T_flange_tcp: Float  # (4, 4) m, tool frame of tools that ``tool_data`` does not name
    T_world_part: Float  # (4, 4) m, frame of the part in the controller's world, which lies at the height of axis 2
    blend_m: float = 0.5e-3  # Leave and reach of blended points, m
    axis_percent: int = 10  # Speed of movej, per cent
    # Shoulder, elbow and wrist of every point
    configuration: tuple[str, str, str] = ("righty", "epositive", "wpositive")
    cycle_s: float = 0.004
    points_per_file: int = LIMITS.points_per_file
    # Name of the tool variable by number of the tool in the program
    tool_data: Mapping[int, str] = field(default_factory=dict)

    def check(self) -> None:
        """Check ranges. Raises InputError: a setting is out of range, or there are external axes."""
        check_name(self.name, LIMITS, "VAL3")
        super().check()
        if self.external_axes:
            raise InputError("points of VAL3 have no external axes", where="[[external_axes]]",
                             hint="Give the part frame where they stand, without them")  # fmt: skip


def frame_text(T: Float) -> str:
    """``x= y= z= rx= ry= rz=`` of a pose (4, 4) m: mm and deg."""
    places = [number(float(value) / MM, LIMITS.position_decimals) for value in T[:3, 3]]
    angles = [number(angle, LIMITS.angle_decimals) for angle in rotations_of(T[:3, :3])]
    return " ".join(f'{name}="{value}"' for name, value in zip(LETTERS, [*places, *angles], strict=True))


class Application:
    """Points, speeds and tools of an application, as its programs come to need them."""

    def __init__(self, settings: Val3Settings) -> None:
        self.settings = settings
        self._points: list[str] = []
        self._speeds: dict[str, int] = {}
        self._own_tool = False

    def point(self, T_part_tcp: Float) -> str:
        """Name of a new point."""
        shoulder, elbow, wrist = self.settings.configuration
        self._points.append(
            f'{frame_text(T_part_tcp)} shoulder="{shoulder}" elbow="{elbow}" wrist="{wrist}" fatherId="fPart[0]"'
        )
        return f"pPath[{len(self._points) - 1}]"

    def speed(self, speed_m_s: float, *, exact: bool) -> str:
        """Name of the mdesc of a speed, m/s; 0: as fast as the axes at ``axis_percent``."""
        settings = self.settings
        vel = settings.axis_percent if speed_m_s <= 0.0 else 100
        tmax = number(speed_m_s / MM_PER_S, 5) if speed_m_s > 0.0 else "99999"
        blend = 'blend="off"' if exact else 'blend="cartesian"'
        reach = number(settings.blend_m / MM, 3)
        text = (
            f'accel="100" vel="{vel}" decel="100" tmax="{tmax}" rmax="{settings.orientation_deg_s:g}" {blend} '
            f'leave="{reach}" reach="{reach}"'
        )
        return f"mSpeed[{self._speeds.setdefault(text, len(self._speeds))}]"

    def tool(self, tool: int) -> str:
        """Name of a tool."""
        name = self.settings.tool_data.get(tool)
        self._own_tool |= name is None
        return "tPath[0]" if name is None else f"{name}[0]"

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """A program file."""
        if name not in _ENTRIES:
            check_name(name, LIMITS, "VAL3")
        code = "".join(f"  {line}\n" for line in lines)
        head = f'{_XML}\n<Programs xmlns="{_SCHEMA}/Program/2">\n  <Program name="{name}">'
        return {
            f"{name}.pgx": f"{head}\n    <Code><![CDATA[\nbegin\n{code}end\n    ]]></Code>\n  </Program>\n</Programs>\n"
        }

    def project(self, programs: Sequence[str]) -> dict[str, str]:
        """Data, ``start.pgx``, ``stop.pgx`` and the project."""
        settings, name = self.settings, self.settings.name
        axes = " ".join(
            f'j{i}="{number(angle / DEG, LIMITS.angle_decimals)}"'
            for i, angle in enumerate(settings.start_axes_rad, start=1)
        )
        variables = [
            ("fPart", "frame", [f'{frame_text(settings.T_world_part)} fatherId="world[0]"']),
            *([("tPath", "tool", [f'{frame_text(settings.T_flange_tcp)} fatherId="flange[0]"'])] * self._own_tool),
            ("jStart", "jointRx", [axes]),
            ("mSpeed", "mdesc", list(self._speeds)),
            ("pPath", "pointRx", self._points),
        ]
        data = [
            _XML,
            f'<Database xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns="{_SCHEMA}/Data/2">',
            "  <Datas>",
        ]
        for variable, kind, values in variables:
            data.append(
                f'    <Data name="{variable}" access="private" xsi:type="array" type="{kind}" size="{len(values)}">'
            )
            data += [f'      <Value key="{key}" {value} />' for key, value in enumerate(values)]
            data.append("    </Data>")
        files = {f"{name}.dtx": "\n".join([*data, "  </Datas>", "</Database>", ""])}
        files |= self.program("start", [f"call {name}()"]) | self.program("stop", ["resetMotion()"])
        listed = "".join(f'    <Program file="{one}" />\n' for one in (*programs, "start.pgx", "stop.pgx"))
        files[f"{name}.pjx"] = (
            f'{_XML}\n<Project xmlns="{_SCHEMA}/Project/3">\n  <Parameters version="s7.3.1" stackSize="5000" '
            f'millimeterUnit="true" />\n  <Programs>\n{listed}  </Programs>\n  <Database>\n'
            f'    <Data file="{name}.dtx" />\n'
            "  </Database>\n  <Libraries />\n</Project>\n"
        )
        return files


class Val3Words(RobotWords[Val3Settings]):
    """Programs of an application."""

    language, sign, stop = "val3", "//", "waitEndMove()\n  get()"

    @cached_property
    def application(self) -> Application:
        """Its points, speeds and tools."""
        return Application(self.settings)

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """A program file."""
        return self.application.program(name, lines)

    def call(self, part: str) -> str:
        """A program of the application."""
        return f"call {part}()"

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """movej, movel or movec to elements of ``pPath`` in the part frame."""
        del external
        app = self.application
        word = "movej" if free else "movel" if len(Ts_part_tcp) == 1 else "movec"
        points = ",".join(app.point(T) for T in Ts_part_tcp)
        return [f"{word}({points},{app.tool(self.tool)},{app.speed(0.0 if free else speed_m_s, exact=exact)})"]


class Val3Emitter(Val3Words, RobotEmitter[Val3Settings]):
    """A converted program as an application."""

    def end(self) -> dict[str, str]:
        """Programs, data and project."""
        files = super().end()
        return files | self.application.project(list(files))

    def dwell(self, move: Move) -> None:
        """delay, at rest."""
        self.lines += ["waitEndMove()", f"delay({number(move.motion.duration_s, 4)})"]


class Val3Writer(Val3Words, RobotWriter[Val3Settings]):
    """A commanded path as an application."""

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """The controller runs ahead of the motion: it waits where a point must be reached."""
        lines = super().motion(Ts_part_tcp, speed_m_s, exact=exact, free=free, external=external)
        return [*lines, *(["waitEndMove()"] if exact else [])]

    def start(self, lead: Sequence[str]) -> list[str]:
        """Return origin, start posture."""
        app = self.application
        move = f"movej(jStart[0],{app.tool(self.first_tool)},{app.speed(0.0, exact=True)})"
        return [*self.origin(), *lead, move, "waitEndMove()"]

    def dwell(self, time_s: float) -> str:
        """Line that waits, at rest: the controller runs ahead of the motion."""
        return f"delay({number(time_s, 3)})"

    def data(self, files: list[str]) -> dict[str, str]:
        """Points, speeds, project."""
        return self.application.project(files)


def cell_of(cell: Cell) -> Val3Cell:
    """Return the cell as the reader of VAL3 needs it.

    Raises:
        InputError: The robot holds the part: such programs are not read.
    """
    refuse_held_part(cell, "VAL3")
    tools = cell.tables.tools
    return Val3Cell(
        **shared_facts(cell, "val3"),
        tool_of_data={tool.tooldata: tool.number for tool in tools if tool.tooldata is not None},
    )


def configuration(branch: str) -> tuple[str, str, str]:
    """Shoulder, elbow and wrist of VAL3 points in a posture: by the side of the arm and the signs of J3 and J5."""
    arm, elbow, wrist = branch.split()
    bent = (elbow == "up") == (arm == "front")
    return (
        "righty" if arm == "front" else "lefty",
        "epositive" if bent else "enegative",
        "wpositive" if wrist == "noflip" else "wnegative",
    )


def _settings(program: Program, cell: Cell, common: dict[str, Any], branch: str) -> Val3Settings:
    refuse_held_part(cell, "VAL3")
    return Val3Settings(
        **common,
        configuration=configuration(branch),
        T_flange_tcp=cell.controller_chain.T_flange_tcp,
        T_world_part=part_in_world(cell, "val3"),
        blend_m=cell.tables.controller.blending_m,
        tool_data=tool_data(program, cell, "val3"),
    )


def write(order: WritingOrder) -> Written:
    """Write a program of another language as an application."""
    cell = order.cell
    refuse_held_part(cell, "VAL3")
    branch = branch_of(cell.controller_chain, order.plan.q[0])
    settings = _settings(order.job.program, cell, writer_settings(order, "val3", moving=False), branch)
    return robot_text(order, Val3Writer, settings, "val3")


def convert(order: Conversion) -> Val3Emitter:
    """Return the writer of a conversion."""
    settings = _settings(order.program, order.cell, emitter_settings(order), order.cell.tables.posture.branch)
    settings.check()
    return Val3Emitter(order.program, settings, order.cell.machine_functions("val3"), order.tolerance_m)


def load(files: str, cell: Cell, tools: Sequence[int]) -> tuple[Fact, ...]:
    """Files and tool that a program needs."""
    if cell.holds_part:
        return against_fixed_tool(files, cell)
    return (
        Fact("Load", files, "", "as an application; it brings its frame, and its tool unless the cell names one"),
        *tool_frames(cell, "val3", tools, frame=pose_text(cell.controller_chain.T_flange_tcp)),
    )
