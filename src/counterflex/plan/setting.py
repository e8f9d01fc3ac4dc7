"""What planning stands on: robot, part, tools, force law, bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.drive_error import DriveErrors
from counterflex.signals.preview import Mode, Shaping

_NO_ERRORS = DriveErrors()


@dataclass(frozen=True)
class Limits:
    """Bounds on what compensation may do; a plan that needs more is refused, never clipped.

    Attributes:
        correction_m: Largest correction.
        rotation_rad: Largest correction of the orientation.
        joint_margin_rad: Smallest distance to a joint limit.
        wrist_rad: Smallest angle between axes 4 and 6.
    """

    correction_m: float = 3.0 * MM
    rotation_rad: float = 1.0 * DEG
    joint_margin_rad: float = 2.0 * DEG
    wrist_rad: float = 5.0 * DEG


@dataclass(frozen=True, eq=False)
class Setting:
    """All that planning stands on.

    Attributes:
        chain: Robot and end effector as they are known to be (elastic, perhaps with calibrated geometry).
        controller_chain: Robot and end effector as the controller has them; its joint angles are what is commanded.
        T_base_part: (4, 4) part frame as the controller knows it.
        datum_points_part: (k, 3) m where the robot touched the part to measure that frame, or None when it was
            measured from outside.
        branch: Posture of the arm, for example ``front up noflip``.
        rotation_about_tool_rad: Free rotation, see :func:`counterflex.path.toolpath.tool_orientation`.
        law: Force law.
        cutter_of: Gives the cutter of a tool number.
        mode: Lowest structural mode of a tap test, for a chain without masses.
        shaping: How corrections are shaped in time.
        limits: Bounds.
        normal_only: Correct square to the feed only (Haehn2020 eq. 10).
        orientation: Correct the orientation too.
        allow_extrapolation: Accept force from chips outside the law's range.
        drive_errors: Periodic errors and sag of the drives: what the links of ``chain`` truly do at commanded angles.
    """

    chain: ElasticChain
    controller_chain: ElasticChain
    T_base_part: Float
    datum_points_part: Float | None
    branch: str
    rotation_about_tool_rad: float
    law: ForceLaw
    cutter_of: Callable[[int], Cutter]
    mode: Mode
    shaping: Shaping
    limits: Limits
    normal_only: bool = False
    orientation: bool = False
    allow_extrapolation: bool = False
    drive_errors: DriveErrors = _NO_ERRORS
