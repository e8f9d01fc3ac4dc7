"""A tool path together with what has to be commanded so that the loaded tool runs along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float
from counterflex.geometry import rotation
from counterflex.path.toolpath import ToolPath


@dataclass(frozen=True)
class CompensatedPath:
    """Commanded tool-tip poses, row by row beside the nominal path.

    ``p_command = p_nominal + correction`` and ``R_command = exp(rotvec) R_nominal``. A row without a correction equals
    the nominal row bit for bit; writers leave a motion whose rows are all like that untouched.

    Attributes:
        path: Nominal sampled path; ``path.motion`` indexes the motions of the program it was sampled from. The last
            row of every motion is the motion's end point.
        p_part_command: (n, 3) m, commanded tool tip in the part frame.
        rotvec_part_command: (n, 3) rad, correction of the tool's orientation as a rotation vector in part axes.
            Languages without orientation (G-code without rotary axes) drop it and say how large it was.

    Raises:
        InputError: Shapes do not fit the path, or a value is not finite.
    """

    path: ToolPath
    p_part_command: Float
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
