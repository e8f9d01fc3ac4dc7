"""Table ``[tracker]`` of a cell file: where the laser tracker stands and where its target sits."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, UM, URAD
from counterflex.files.schema import Angle, Length, PoseTable
from counterflex.geometry import pose

SigmaUm = Annotated[float, Field(gt=0.0, le=1e6)]
SigmaUrad = Annotated[float, Field(gt=0.0, le=1e6)]


class TrackerTable(PoseTable):
    """Pose of the tracker in the robot base, and of its target on the tool (or on the flange)."""

    sigma_um: tuple[SigmaUm, SigmaUm, SigmaUm] | None = None
    sigma_urad: tuple[SigmaUrad, SigmaUrad, SigmaUrad] | None = None
    target_on: Literal["tcp", "flange"] = "tcp"
    target_x_mm: Length = 0.0
    target_y_mm: Length = 0.0
    target_z_mm: Length = 0.0
    target_a_deg: Angle = 0.0
    target_b_deg: Angle = 0.0
    target_c_deg: Angle = 0.0
    target_sigma_um: tuple[SigmaUm, SigmaUm, SigmaUm] | None = None
    target_sigma_urad: tuple[SigmaUrad, SigmaUrad, SigmaUrad] | None = None
    source: str = ""

    @property
    def T_base_tracker(self) -> Float:
        """(4, 4) m."""
        return self.matrix()

    @property
    def T_on_target(self) -> Float:
        """(4, 4) m, target in the frame that ``target_on`` names."""
        p = np.array([self.target_x_mm, self.target_y_mm, self.target_z_mm]) * MM
        return pose.from_xyz_zyx(p, np.array([self.target_a_deg, self.target_b_deg, self.target_c_deg]) * DEG)

    @property
    def sigma(self) -> Float | None:
        """(6,) m, rad of the tracker's pose in its own axes, or None."""
        return _six(self.sigma_um, self.sigma_urad)

    @property
    def target_sigma(self) -> Float | None:
        """(6,) m, rad of the target's pose in its own axes, or None."""
        return _six(self.target_sigma_um, self.target_sigma_urad)


def _six(um: tuple[float, float, float] | None, urad: tuple[float, float, float] | None) -> Float | None:
    if um is None or urad is None:
        return None
    return np.concatenate([np.array(um) * UM, np.array(urad) * URAD])
