"""ABB RAPID: a compensated path as MoveL instructions in modules."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_S
from counterflex.geometry import rotation
from counterflex.integrations.abb.language import LIMITS
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import check_name
from counterflex.programs.robot_writer.writer import External, Poses, RobotSettings, RobotWords, RobotWriter

_NO_EXTERNAL = "9E9"
UNSUPERVISED: Final = ("ConfJ \\Off;", "ConfL \\Off;")
SUPERVISED: Final = ("ConfJ \\On;", "ConfL \\On;")
"""What the controller has when a program starts (Technical reference manual, RAPID: ConfJ, ConfL)."""


@dataclass(frozen=True, kw_only=True)
class RapidSettings(RobotSettings):
    """Settings of a RAPID module beside those of every language; names have up to 32 characters."""

    T_flange_tcp: Float  # (4, 4) m, tool frame of tools that ``tool_data`` does not name
    T_base_part: Float  # (4, 4) m, work object frame in the controller's world
    tool_mass_kg: float = 1.0  # Mass of the tool in tooldata, > 0
    p_flange_cog: Sequence[float] = (0.0, 0.0, 0.001)  # (3,) m, its centre of gravity
    # (4,) cf1, cf4, cf6, cfx of every target; supervision of linear moves is off
    configuration: tuple[int, int, int, int] = (0, 0, 0, 0)
    zone: str = "z0"  # ``fine``, ``z0``, ``z1``, ``z5`` ..
    start_m_s: float = 0.1  # Speed of the move to the start posture, m/s
    cycle_s: float = 0.024
    points_per_file: int = LIMITS.points_per_file
    # Name of the tooldata on the controller by number of the tool in the program
    tool_data: Mapping[int, str] = field(default_factory=dict)
    # (4, 4) m, frame of a tool that stands, in the controller's world; then the robot holds the work object,
    # ``T_flange_tcp`` is its frame in the flange, and ``T_base_part`` is not looked at
    T_base_tcp: Float | None = None
    work_object: str = ""  # Name of the wobjdata on the controller; empty: the module declares one of its own

    def check(self) -> None:
        """Check ranges. Raises InputError: a setting is out of range."""
        check_name(f"{self.name}_m", LIMITS, "RAPID")
        for tool, name in self.tool_data.items():
            self._check_theirs(name, f"tooldata of T{tool}", "tools.tooldata")
        if self.work_object:
            self._check_theirs(self.work_object, "work object", "controller.work_object")
        super().check()
        as_float("T_flange_tcp", self.T_flange_tcp, (4, 4))
        as_float("T_base_part", self.T_base_part, (4, 4))
        if self.T_base_tcp is not None:
            as_float("T_base_tcp", self.T_base_tcp, (4, 4))
        as_float("p_flange_cog", self.p_flange_cog, (3,))
        for key in ("start_m_s", "tool_mass_kg"):
            as_positive(key, getattr(self, key))
        if not re.fullmatch(r"fine|z(0|1|5|10|15|20|30|40|50|60|80|100|150|200)", self.zone):
            raise InputError("the zone is not a predefined one", value=self.zone, limit="fine, z0, z1, z5, z10 .. z200")

    def _check_theirs(self, name: str, what: str, key: str) -> None:
        """Refuse a name of the controller that the program declares itself."""
        check_name(name, LIMITS, "RAPID")
        own = rf"{self.name}(_m|_\d{{3}}(_m)?)?|[tw]_{self.name[:30]}|v_{self.name[:24]}_\d+|cf[A-Z]\w*"
        if re.fullmatch(own, name, re.IGNORECASE):
            raise InputError(
                f"the {what} is called as something that the program declares itself", value=name,
                limit="another name", hint=f"Rename it on the controller and in {key}, or the program",
            )  # fmt: skip


def rapid_pose(T_a_b: Float, quat_wxyz: Float | None = None) -> str:
    """``[x,y,z],[q1,q2,q3,q4]`` of a pose: mm and a unit quaternion with q1 (scalar) first.

    Args:
        T_a_b: (4, 4), m.
        quat_wxyz: (4,) its quaternion; None is the one with q1 >= 0.
    """
    p = ",".join(number(float(v), LIMITS.position_decimals) for v in T_a_b[:3, 3] / MM)
    values = rotation.quat_wxyz(T_a_b[:3, :3]) if quat_wxyz is None else quat_wxyz
    q = ",".join(number(float(v), LIMITS.angle_decimals) for v in values)
    return f"[{p}],[{q}]"


class SteadyQuaternions:
    """Quaternions of successive targets, each of the sign that lies nearer to the one before."""

    def __init__(self) -> None:
        self._last: Float = np.array([1.0, 0.0, 0.0, 0.0])

    def of(self, R: Float) -> Float:
        """(4,) scalar first, of a rotation (3, 3)."""
        q = rotation.quat_wxyz(R)
        self._last = -q if float(q @ self._last) < 0.0 else q
        return self._last


class RapidWords(RobotWords[RapidSettings]):
    """Modules, the main one with what all declare."""

    language, sign, stop = "rapid", "!", "Stop;"

    @cached_property
    def _quaternions(self) -> SteadyQuaternions:
        return SteadyQuaternions()

    @property
    def _wobj(self) -> str:
        return self.settings.work_object or f"w_{self.settings.name[:30]}"

    def _tool_name(self, tool: int) -> str:
        return self.settings.tool_data.get(tool, f"t_{self.settings.name[:30]}")

    @abstractmethod
    def declared(self) -> tuple[list[str], bool, list[tuple[str, str]]]:
        """Comments at the head, whether a tool of its own is named, and names of speeds with their values."""

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """One module."""
        settings, head = self.settings, list[str]()
        check_name(f"{name}_m", LIMITS, "RAPID")
        if name == settings.name:
            head, own, speeds = self.declared()
            head += [rapid_tool(settings, self._tool_name(0))] if own else []
            head += [] if settings.work_object else [rapid_part(settings, self._wobj)]
            head += [f"CONST speeddata {speed}:={value};" for speed, value in speeds]
        return {f"{name}.mod": rapid_module(name, [f"  {one}" for one in head], [f"    {line}" for line in lines])}

    def call(self, part: str) -> str:
        """A routine of another module."""
        return f"{part};"

    @abstractmethod
    def speed_name(self, speed_m_s: float) -> str:
        """Name of the speeddata of a speed."""

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """MoveJ, MoveL or MoveC in the work object (the part frame)."""
        settings = self.settings
        word = "MoveJ" if free else "MoveL" if len(Ts_part_tcp) == 1 else "MoveC"
        conf = ",".join(str(int(c)) for c in settings.configuration)
        axes = rapid_external(settings.external_axes if external is None else external)
        targets = [f"[{rapid_pose(T, self._quaternions.of(T[:3, :3]))},[{conf}],{axes}]" for T in Ts_part_tcp]
        frames = f"{self._tool_name(self.tool)}\\WObj:={self._wobj}"
        zone = "fine" if exact else settings.zone
        return [f"{word} {','.join(targets)},{self.speed_name(speed_m_s)},{zone},{frames};"]


class RapidWriter(RapidWords, RobotWriter[RapidSettings]):
    """A commanded path in RAPID, with declared speeddata."""

    @cached_property
    def _speeds(self) -> dict[float, str]:
        """Names of the speeddata by speed, m/s."""
        used = {float(speed) for speed in self.points.speed_m_s if speed > 0.0} | {self.settings.rapid_m_s}
        return {speed: f"v_{self.settings.name[:24]}_{i}" for i, speed in enumerate(sorted(used), start=1)}

    def speed_name(self, speed_m_s: float) -> str:
        """Name by its rank among the speeds of the path."""
        return self._speeds[speed_m_s]

    def frames(self, tool: int) -> list[str]:
        """Supervision of the configuration off: every instruction names its frames."""
        del tool
        return list(UNSUPERVISED)

    def start(self, lead: Sequence[str]) -> list[str]:
        """First tool, start posture."""
        settings = self.settings
        axes = ",".join(number(a / DEG, 5) for a in settings.start_axes_rad)
        tool, speed = self._tool_name(self.first_tool), self._speed_data(settings.start_m_s)
        move = f"MoveAbsJ [[{axes}],{rapid_external(settings.external_axes)}],{speed},fine,{tool}\\WObj:={self._wobj};"
        return [*lead, *UNSUPERVISED, move]

    def finish(self) -> list[str]:
        """Supervision of the configuration on again, as it was."""
        return list(SUPERVISED)

    def declared(self) -> tuple[list[str], bool, list[tuple[str, str]]]:
        """Return comments about the origin, tool and speeds."""
        used = {motion.tool for motion in self.original.motions if motion.tool}
        own = not used or not used <= self.settings.tool_data.keys()
        return self.origin(), own, [(name, self._speed_data(speed)) for speed, name in self._speeds.items()]

    def _speed_data(self, speed_m_s: float) -> str:
        return f"[{number(speed_m_s / MM_PER_S, 4)},{number(self.settings.orientation_deg_s, 3)},5000,1000]"


def rapid_external(values: Mapping[int, float]) -> str:
    """``[...]`` of external axes by number, mm or deg; 9E9: there is none."""
    return "[" + ",".join(number(values[i], 5) if i in values else _NO_EXTERNAL for i in range(1, 7)) + "]"


def rapid_tool(settings: RapidSettings, name: str) -> str:
    """Declaration of the tool, as the cell has it."""
    cog = ",".join(number(float(v) / MM, 4) for v in settings.p_flange_cog)
    load = f"[{settings.tool_mass_kg:.4f},[{cog}],[1,0,0,0],0,0,0]"
    stands = settings.T_base_tcp is not None
    T = settings.T_flange_tcp if settings.T_base_tcp is None else settings.T_base_tcp
    return f"PERS tooldata {name}:=[{'FALSE' if stands else 'TRUE'},[{rapid_pose(np.asarray(T))}],{load}];"


def rapid_part(settings: RapidSettings, name: str) -> str:
    """Declaration of the work object, as the cell has it."""
    held = settings.T_base_tcp is not None
    T = settings.T_flange_tcp if held else settings.T_base_part
    frame = f"[{rapid_pose(np.asarray(T))}],[[0,0,0],[1,0,0,0]]"
    return f'PERS wobjdata {name}:=[{"TRUE" if held else "FALSE"},TRUE,"",{frame}];'


def rapid_module(procedure: str, declarations: Sequence[str], body: Sequence[str]) -> str:
    """Text of a module with one routine."""
    head = [f"MODULE {procedure}_m", *declarations, f"  PROC {procedure}()"]
    return "\n".join([*head, *body, "  ENDPROC", "ENDMODULE", ""])
