"""KUKA KRL: a compensated path as LIN instructions with C_DIS, in .src and .dat files."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.geometry import rotation
from counterflex.integrations.kuka.language import LIMITS
from counterflex.programs.gcode.write.written_line import number
from counterflex.programs.limits import check_name
from counterflex.programs.robot_writer.writer import External, Poses, RobotSettings, RobotWords, RobotWriter


@dataclass(frozen=True, kw_only=True)
class KrlSettings(RobotSettings):
    """Settings of a KRL program beside those of every language; names have up to 24 characters."""

    tool: int | Float = 1  # Number of TOOL_DATA, or T_flange_tcp (4, 4) in m, of tools that ``tool_data`` does not name
    base: int | Float = 1  # Number of BASE_DATA, or T_base_part (4, 4) in m: KUKA's BASE is the frame of the workpiece
    status: int | None = None  # S of the first Cartesian point; with ``turn`` it is approached by PTP, else by LIN
    turn: int | None = None  # T of the first Cartesian point
    acc_m_s2: float = 1.0  # $ACC.CP, m/s^2
    blend_m: float = 0.5e-3  # $APO.CDIS, m
    axis_percent: int = 10  # Speed and acceleration of PTP, per cent, 1 to 100
    cycle_s: float = 0.012
    points_per_file: int = LIMITS.points_per_file
    # Number of TOOL_DATA by number of the tool in the program
    tool_data: Mapping[int, int] = field(default_factory=dict)
    # The robot holds the part against a spindle that stands: BASE_DATA is the tool in the world and TOOL_DATA the
    # workpiece in the flange, as KUKA has it; ``tool_data`` then has numbers of BASE_DATA
    fixed_tool: bool = False

    def check(self) -> None:
        """Check ranges. Raises InputError: a setting is out of range."""
        check_name(self.name, LIMITS, "KRL")
        super().check()
        as_positive("acc_m_s2", self.acc_m_s2)
        as_positive("blend_m", self.blend_m, zero=True)
        if not 1 <= self.axis_percent <= 100:
            raise InputError("axis_percent is out of range", value=self.axis_percent, limit="1 .. 100")
        if (self.status is None) != (self.turn is None):
            raise InputError("S and T come together", value=(self.status, self.turn))


def krl_pose(T_a_b: Float) -> str:
    """``X .., Y .., Z .., A .., B .., C ..`` of a pose: mm and deg, ``R = Rz(A) Ry(B) Rx(C)``.

    Args:
        T_a_b: (4, 4), m.

    Returns:
        The components of a KRL FRAME without braces.
    """
    p = T_a_b[:3, 3] / MM
    angles = rotation.to_zyx(T_a_b[:3, :3]) / DEG
    words = [f"{c} {number(float(v), LIMITS.position_decimals)}" for c, v in zip("XYZ", p, strict=True)]
    words += [f"{c} {number(float(v), LIMITS.angle_decimals)}" for c, v in zip("ABC", angles, strict=True)]
    return ",".join(words)


class KrlWords(RobotWords[KrlSettings]):
    """KRL: ``LIN {X,Y,Z,A,B,C} C_DIS`` in KUKA's BASE; $VEL.CP is set where it changes."""

    language, sign, stop = "krl", ";", "HALT"

    def program(self, name: str, lines: Sequence[str]) -> dict[str, str]:
        """``.src`` and ``.dat``."""
        check_name(name, LIMITS, "KRL")
        return {f"{name}.src": krl_source(name, lines), f"{name}.dat": krl_data(name, [])}

    def call(self, part: str) -> str:
        """A subprogram."""
        return f"{part}( )"

    @abstractmethod
    def velocity(self, speed_m_s: float) -> list[str]:
        """Line that sets $VEL.CP, where it changes."""

    def motion(
        self, Ts_part_tcp: Poses, speed_m_s: float, *, exact: bool, free: bool = False, external: External = None
    ) -> list[str]:
        """PTP, LIN or CIRC; external axes are named where they move along the program."""
        word = "PTP" if free else "LIN" if len(Ts_part_tcp) == 1 else "CIRC"
        axes = krl_external(external or {}) if self.settings.places else ""
        poses = ",".join(f"{{{krl_pose(T)}{axes}}}" for T in Ts_part_tcp)
        behind = "" if exact else " C_PTP" if free else " C_DIS"
        return [*([] if free else self.velocity(speed_m_s)), f"{word} {poses}{behind}"]


class KrlWriter(KrlWords, RobotWriter[KrlSettings]):
    """A commanded path in KRL."""

    _velocity: float | None = None

    def velocity(self, speed_m_s: float) -> list[str]:
        """$VEL.CP with six decimals."""
        before, self._velocity = self._velocity, speed_m_s
        return [] if speed_m_s == before else [f"$VEL.CP={speed_m_s:.6f}"]

    def frames(self, tool: int) -> list[str]:
        """Frames and speeds of a tool."""
        self._velocity = None
        return krl_frames(self.settings, tool)

    def point(self, index: int) -> list[str]:
        """A point: LIN, or PTP to the first one where its S and T are given."""
        lines, settings = super().point(index), self.settings
        if index == 0 and settings.status is not None:
            lines[-1] = f"PTP{lines[-1][3:-1]},S {settings.status},T {settings.turn}}}"
        return lines

    def start(self, lead: Sequence[str]) -> list[str]:
        """Return origin, first tool, frames and speeds, start posture."""
        return [*self.origin(), *lead, *self.frames(self.first_tool), "PTP XSTART"]

    def data(self, files: list[str]) -> dict[str, str]:
        """The main ``.dat``: the start posture."""
        del files
        angles = enumerate(self.settings.start_axes_rad, start=1)
        axes = ",".join(f"A{i} {number(a / DEG, LIMITS.angle_decimals)}" for i, a in angles)
        axes += krl_external(self.settings.external_axes)
        name = self.settings.name
        return {f"{name}.dat": krl_data(name, [f"DECL E6AXIS XSTART={{{axes}}}"])}


def krl_external(values: Mapping[int, float]) -> str:
    """``,E1 ..`` of external axes by number, mm or deg; empty where there are none."""
    return "".join(f",E{axis} {number(value, LIMITS.position_decimals)}" for axis, value in sorted(values.items()))


def krl_frames(settings: KrlSettings, tool: int) -> list[str]:
    """Lines that set the frames of a tool, and speeds."""
    percent = settings.axis_percent
    if settings.fixed_tool:
        frames = [
            f"$TOOL=BASE_DATA[{settings.tool_data.get(tool, settings.base)}]",
            f"$BASE=TOOL_DATA[{settings.tool}]",
            "$IPO_MODE=#TCP",
        ]
    else:
        frames = [
            _frame("TOOL", settings.tool_data.get(tool, settings.tool)),
            _frame("BASE", settings.base),
            "$IPO_MODE=#BASE",
        ]
    return [
        *frames,
        "$ORI_TYPE=#VAR",
        "$ADVANCE=3",
        *(f"$VEL_AXIS[{i}]={percent}" for i in range(1, 7)),
        *(f"$ACC_AXIS[{i}]={percent}" for i in range(1, 7)),
        f"$ACC.CP={settings.acc_m_s2:.4f}",
        f"$VEL.ORI1={settings.orientation_deg_s:.3f}",
        f"$VEL.ORI2={settings.orientation_deg_s:.3f}",
        f"$APO.CDIS={number(settings.blend_m / MM, 4)}",
    ]


def krl_source(name: str, body: Sequence[str]) -> str:
    """Text of a ``.src`` file."""
    return "\n".join(["&ACCESS RVP", "&REL 1", f"DEF {name}( )", *body, "END", ""])


def krl_data(name: str, body: Sequence[str]) -> str:
    """Text of a ``.dat`` file."""
    return "\n".join(["&ACCESS RVP", "&REL 1", f"DEFDAT {name}", *body, "ENDDAT", ""])


def _frame(word: str, value: int | Float) -> str:
    if isinstance(value, (int, np.integer)):
        return f"${word}={word}_DATA[{int(value)}]"
    return f"${word}={{{krl_pose(as_float(word, value, (4, 4)))}}}"
