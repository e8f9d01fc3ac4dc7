"""Files of a VAL3 application that is written anew: programs, data, project."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.integrations.staubli.language import LIMITS
from counterflex.integrations.staubli.language.program import LETTERS, rotations_of
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import check_name
from counterflex.programs.robot_writer.writer import RobotSettings

_XML = '<?xml version="1.0" encoding="utf-8"?>'
_ENTRIES = ("start", "stop")
"""Programs that a controller calls in every application."""
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
        """Check ranges.

        Raises:
            InputError: A setting is out of range, or there are external axes.
        """
        check_name(self.name, LIMITS, "VAL3")
        super().check()
        if self.external_axes:
            raise InputError("points of VAL3 have no external axes", where="[[external_axes]]",
                             hint="Give the part frame where they stand, without them")  # fmt: skip


def pose_text(T: Float) -> str:
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
            f'{pose_text(T_part_tcp)} shoulder="{shoulder}" elbow="{elbow}" wrist="{wrist}" fatherId="fPart[0]"'
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
            ("fPart", "frame", [f'{pose_text(settings.T_world_part)} fatherId="world[0]"']),
            *([("tPath", "tool", [f'{pose_text(settings.T_flange_tcp)} fatherId="flange[0]"'])] * self._own_tool),
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
