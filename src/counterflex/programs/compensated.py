"""A program's motions as a sampled tool path, and with it what is commanded so that the loaded tool runs along it.

A compensated program says in a comment which plan it was written from.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float
from counterflex.core.errors import InputError, ProgramError
from counterflex.core.units import DEG
from counterflex.geometry import rotation
from counterflex.path.sampling import ARC_MOTION, DWELL_MOTION, FEED_MOTION, RAPID_MOTION, MotionTable, sample
from counterflex.path.toolpath import ToolPath
from counterflex.programs.program import Program

_KIND: Final = {"rapid": RAPID_MOTION, "feed": FEED_MOTION, "arc": ARC_MOTION, "dwell": DWELL_MOTION}
_ZERO: Final = (0.0, 0.0, 0.0)


def motion_table(program: Program) -> MotionTable:
    """Return the motions of a three-axis program as columns.

    Raises:
        ProgramError: The program turns a rotary axis: how A, B and C turn the tool in the part frame belongs to the
            machine that the program was written for and is not defined for a robot.
    """
    for motion in program.motions:
        if motion.abc_end != _ZERO or motion.abc_start != _ZERO:
            block = program.blocks[motion.block]
            turned = [round(angle / DEG, 6) for angle in motion.abc_end]
            raise ProgramError(
                "the program moves a rotary axis, whose meaning for a robot is not defined",
                where=f"{block.where(program.name)}:1", value=f"A B C = {turned} deg", limit="A B C = 0",
                hint="Describe the machine in [machine] of the cell file, or post the program as three-axis milling",
            )  # fmt: skip
    return programmed_motions(program)


def programmed_motions(program: Program) -> MotionTable:
    """Return the motions as columns, points as programmed; where the tool turns they need not be those of its tip.

    A motion of rotary axes alone has no length; its feed is given as 1 m/s, which means nothing.
    """
    motions, n = program.motions, len(program.motions)
    centre, normal = np.zeros((n, 3)), np.zeros((n, 3))
    for index, motion in enumerate(motions):
        if motion.p_centre is not None and motion.normal is not None:
            centre[index] = motion.p_centre
            normal[index] = motion.normal
    return MotionTable(
        kind=np.array([_KIND[motion.kind] for motion in motions], dtype=np.int64),
        p_start=np.array([motion.p_start for motion in motions], dtype=np.float64).reshape(n, 3),
        p_end=np.array([motion.p_end for motion in motions], dtype=np.float64).reshape(n, 3),
        feed_m_s=np.array([motion.feed_m_s or float(motion.feed_rad_s > 0.0) for motion in motions], dtype=np.float64),
        spindle_rad_s=np.array([motion.spindle_rad_s for motion in motions], dtype=np.float64),
        tool=np.array([motion.tool for motion in motions], dtype=np.int64),
        duration_s=np.array([motion.duration_s for motion in motions], dtype=np.float64),
        p_centre=centre,
        normal=normal,
        turn_rad=np.array([motion.turn_rad for motion in motions], dtype=np.float64),
    )


def tool_path(
    program: Program,
    *,
    step_m: float = 1e-3,
    rapid_speed_m_s: float = 0.5,
    chord_m: float = 5e-6,
    step_s: float = math.inf,
) -> ToolPath:
    """Sample the motions of a three-axis program.

    Args:
        step_m: Longest step of feed and arc motions, m, > 0.
        rapid_speed_m_s: Speed assumed for rapids, m/s, > 0.
        chord_m: Allowed chord error of arcs, m, > 0.
        step_s: Longest time of a step, s, > 0.

    Returns:
        The tool path; its column ``motion`` indexes ``program.motions``.

    Raises:
        ProgramError: The program turns a rotary axis.
        InputError: An argument is out of range.
    """
    return sample(motion_table(program), step_m=step_m, rapid_speed_m_s=rapid_speed_m_s, chord_m=chord_m, step_s=step_s)


@dataclass(frozen=True)
class CompensatedPath:
    """Commanded tool-tip poses, row by row beside the nominal path.

    ``p_command = p_nominal + correction`` and ``R_command = exp(rotvec) R_nominal``. A row without a correction equals
    the nominal row bit for bit; writers leave a motion whose rows are all like that untouched.

    Raises:
        InputError: Shapes do not fit the path, or a value is not finite.
    """

    # Nominal sampled path; ``path.motion`` indexes the motions of the program it was sampled from. The last row of
    # every motion is the motion's end point.
    path: ToolPath
    p_part_command: Float  # (n, 3) m, commanded tool tip in the part frame
    # (n, 3) rad, correction of the tool's orientation as a rotation vector in part axes. Languages without orientation
    # (G-code without rotary axes) drop it and say how large it was.
    rotvec_part_command: Float

    def __post_init__(self) -> None:
        """Check shapes."""
        n = len(self.path)
        for name in ("p_part_command", "rotvec_part_command"):
            as_float(name, getattr(self, name), (n, 3))

    @classmethod
    def from_correction(
        cls, path: ToolPath, correction_part: Float, rotvec_part: Float | None = None
    ) -> CompensatedPath:
        """Build from corrections instead of positions.

        Args:
            path: Nominal path, n rows.
            correction_part: (n, 3) m, what is added to the nominal position, in part axes.
            rotvec_part: (n, 3) rad, rotation correction in part axes; zero when left out.

        Returns:
            The compensated path; rows with a zero correction are the nominal ones bit for bit.

        Raises:
            InputError: Shapes do not fit, or a value is not finite.
        """
        n = len(path)
        shift = as_float("correction_part", correction_part, (n, 3))
        turn = np.zeros((n, 3)) if rotvec_part is None else as_float("rotvec_part", rotvec_part, (n, 3))
        command: Float = np.where(shift == 0.0, path.p_part_tcp, path.p_part_tcp + shift)
        return cls(path, command, turn)

    @classmethod
    def nominal(cls, path: ToolPath) -> CompensatedPath:
        """The path without any correction."""
        return cls(path, path.p_part_tcp.copy(), np.zeros((len(path), 3)))

    @property
    def correction_part(self) -> Float:
        """(n, 3) m, commanded minus nominal position in part axes; exactly zero where nothing is corrected."""
        out: Float = self.p_part_command - self.path.p_part_tcp
        return out

    @property
    def moved(self) -> Bool:
        """(n,) True where the commanded position differs from the nominal one in any bit."""
        out: Bool = np.any(self.p_part_command != self.path.p_part_tcp, axis=1)
        return out

    @property
    def turned(self) -> Bool:
        """(n,) True where the commanded orientation differs from the nominal one."""
        out: Bool = np.any(self.rotvec_part_command != 0.0, axis=1)
        return out

    def poses(self, R_part_nominal: Float) -> Float:
        """Commanded poses of the tool frame whose nominal orientation is given.

        Args:
            R_part_nominal: (n, 3, 3), nominal orientation of the tool frame in the part frame; its z is
                ``-axis_part``, the rotation about it is the caller's choice.

        Returns:
            (n, 4, 4) ``Ts_part_tcp``: position ``p_part_command``, rotation ``exp(rotvec) R_part_nominal``.

        Raises:
            InputError: The number of rows differs from the path's.
        """
        n = len(self.path)
        nominal = as_float("R_part_nominal", R_part_nominal, (n, 3, 3))
        Ts_part_tcp = np.zeros((n, 4, 4))
        Ts_part_tcp[:, :3, :3] = rotation.exp(self.rotvec_part_command) @ nominal
        Ts_part_tcp[:, :3, 3] = self.p_part_command
        Ts_part_tcp[:, 3, 3] = 1.0
        return Ts_part_tcp


_HASH: Final = re.compile(r"[0-9a-f]{16}")
_MARK: Final = re.compile(r"\bcounterflex job ([0-9a-f]{16})\b")


def mark(job: str) -> str:
    """Text of the comment, without the language's own signs.

    Args:
        job: Hash of the plan, 16 hexadecimal digits.

    Raises:
        InputError: It is none.
    """
    if not _HASH.fullmatch(job):
        raise InputError("not the hash of a job", value=job, limit="16 hexadecimal digits")
    return f"counterflex job {job}"


def marks(text: str) -> tuple[str, ...]:
    """Hashes that a program carries, in order, each once: none in an original program, one in a compensated one."""
    return tuple(dict.fromkeys(_MARK.findall(text)))


def job_number(job: str) -> int:
    """Number by which a running robot program says of which job it is: 2 to 1048577, exact in a REAL of 32 bits.

    The first 20 bits of the hash, above 1: 0 and 1 say no more than off and on.

    Args:
        job: Hash of the plan, 16 hexadecimal digits.

    Raises:
        InputError: It is none.
    """
    mark(job)
    return 2 + int(job[:5], 16)


def refuse_compensated(program: Program) -> None:
    """Refuse a program that carries the mark of a plan. Raises InputError: it is compensated already."""
    carried = marks("\n".join(program.lines))
    if carried:
        raise InputError(
            "the program is compensated already and would be compensated twice", where=Path(program.name).name,
            value=f"job {', '.join(carried)}", hint="Give the original program",
        )  # fmt: skip
