"""Tables ``[posture]``, ``[dynamics]`` and ``[limits]`` of a cell file: what planning needs beside robot and part.

Fields are in shop units, as in the file; properties are what they become in SI, and nothing else converts them.
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from counterflex.core.arrays import Float
from counterflex.core.units import DEG, MM, MS, UM
from counterflex.files.cell.controller import ControllerTable
from counterflex.files.schema import Table
from counterflex.path.tool_rotation import ToolRotation
from counterflex.plan.feed_schedule import SWING_M
from counterflex.plan.inputs import CorrectionLimits
from counterflex.plan.lowest_mode import ASSUMED_DAMPING, Damping
from counterflex.plan.preflight.row import CheckLimits
from counterflex.programs.robot_writer.writer import RobotSettings
from counterflex.robot.model.description import Robot
from counterflex.signals.preview import Mode, Shaping

NonNegative = Annotated[float, Field(ge=0.0)]
_SAME_DEG = 1e-3
_OF_CONTROLLER = ("acceleration_mm_s2", "blending_mm")
_Rate = Annotated[float, Field(gt=0.0, le=100_000.0)]
SixRates = tuple[_Rate, _Rate, _Rate, _Rate, _Rate, _Rate]
CableAngle = Annotated[float, Field(gt=0.0, le=3600.0)]


class PostureTable(Table):
    """Posture of the arm, and the free rotation about the tool axis."""

    shoulder: Literal["front", "back"] = "front"
    elbow: Literal["up", "down"] = "up"
    wrist: Literal["noflip", "flip"] = "noflip"
    rotation_about_tool_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    turning_mm_deg: Annotated[tuple[tuple[float, float], ...], Field(max_length=100_000)] = ()
    turning_at_mm: Annotated[tuple[tuple[float, float, float], ...], Field(max_length=100_000)] = ()

    @model_validator(mode="after")
    def _rises(self) -> PostureTable:
        places = [place for place, _ in self.turning_mm_deg]
        if any(second <= first for first, second in itertools.pairwise(places)):
            raise ValueError("the places of turning_mm_deg do not rise; list them along the program, each once")
        if places and abs(self.turning_mm_deg[0][1] - self.rotation_about_tool_deg) > _SAME_DEG:
            raise ValueError(
                f"turning_mm_deg begins at {self.turning_mm_deg[0][1]:g} deg and rotation_about_tool_deg is "
                f"{self.rotation_about_tool_deg:g}; expected the same"
            )
        if len(self.turning_at_mm) != len(places):
            raise ValueError(
                f"turning_at_mm has {len(self.turning_at_mm)} points and turning_mm_deg {len(places)} rows; expected "
                "as many: where the tool tip is in the part frame at each place, by which another program is told apart"
            )
        return self

    @property
    def turning(self) -> ToolRotation | None:
        """Return how the tool turns about its axis along the program; None where it does not."""
        if not self.turning_mm_deg:
            return None
        places, angles = zip(*self.turning_mm_deg, strict=True)
        points = tuple((x * MM, y * MM, z * MM) for x, y, z in self.turning_at_mm)
        return ToolRotation(tuple(place * MM for place in places), tuple(angle * DEG for angle in angles), points)

    def rotations_rad(self, p_part_tcp: Float) -> float | Float:
        """Free rotation at all points (n, 3) m of a program, in their order: one angle, or (n,) where it turns."""
        return self.rotation_about_tool_rad if self.turning is None else self.turning.along(p_part_tcp)

    @property
    def branch(self) -> str:
        """The posture as the inverse kinematics names it."""
        return f"{self.shoulder} {self.elbow} {self.wrist}"

    @property
    def rotation_about_tool_rad(self) -> float:
        """Free rotation, see :func:`counterflex.path.toolpath.tool_orientation`."""
        return self.rotation_about_tool_deg * DEG


class DynamicsTable(Table):
    """Dynamics of the robot: its lowest mode, and how a correction must be shaped to act like the force."""

    mode_hz: Annotated[float, Field(gt=0.0, le=1e4)] | None = None
    damping_ratio: Annotated[float, Field(gt=0.0, lt=2.0)] | None = None
    correction_smoothing_ms: Annotated[float, Field(ge=0.0, le=1000.0)] = 20.0
    correction_lead_ms: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    swing_um: Annotated[float, Field(ge=0.0, le=10000.0)] = SWING_M / UM

    @model_validator(mode="after")
    def _damping_of_something(self) -> DynamicsTable:
        if self.damping_ratio is not None and self.mode_hz is None:
            raise ValueError("damping_ratio is that of the lowest mode; expected mode_hz beside it")
        return self

    @property
    def swing_m(self) -> float:
        """Largest swing that one change may start; 0 leaves the feed as it is."""
        return self.swing_um * UM

    @property
    def mode(self) -> Mode | None:
        """The lowest mode of a tap test: angular frequency ``2 pi f`` and damping; None: it was not measured."""
        if self.mode_hz is None:
            return None
        return Mode(2.0 * math.pi * self.mode_hz, self.damping_ratio or ASSUMED_DAMPING)

    @property
    def damping(self) -> Damping:
        """Damping of the robot's modes: of the tap test (an overdamped mode as 0.95), otherwise assumed."""
        return Damping.of(None if self.damping_ratio is None else min(self.damping_ratio, 0.95))

    @property
    def shaping(self) -> Shaping:
        """Return how corrections are shaped in time."""
        return Shaping(smoothing_s=self.correction_smoothing_ms * MS, lead_s=self.correction_lead_ms * MS)


class LimitsTable(Table):
    """Bounds on what compensation may do."""

    correction_mm: Annotated[float, Field(gt=0.0, le=100.0)] = 3.0
    correction_deg: Annotated[float, Field(gt=0.0, le=45.0)] = 1.0
    joint_margin_deg: NonNegative = 2.0
    wrist_singularity_deg: NonNegative = 5.0
    joint_speed_deg_s: SixRates | None = None
    joint_acceleration_deg_s2: SixRates | None = None
    cable_axis4_deg: CableAngle | None = None
    cable_axis6_deg: CableAngle | None = None
    clearance_mm: Annotated[float, Field(ge=0.0, le=1000.0)] = 20.0
    orientation_speed_deg_s: Annotated[float, Field(gt=0.0, le=10_000.0)] | None = None
    corner_error_um: Annotated[float, Field(gt=0.0, le=100_000.0)] | None = None
    reversal_error_um: Annotated[float, Field(gt=0.0, le=100_000.0)] = 50.0

    def preflight(self, controller: ControllerTable, robot: Robot) -> CheckLimits:
        """Return what a preflight compares with; speeds and accelerations of the catalogue where the file has none.

        Args:
            controller: Table ``[controller]``.
        """
        cables = {3: self.cable_axis4_deg, 5: self.cable_axis6_deg}
        speeds, accelerations = self.joint_speed_deg_s, self.joint_acceleration_deg_s2
        turning = self.orientation_speed_deg_s
        assumed = {f"controller.{key}" for key in _OF_CONTROLLER if key not in controller.model_fields_set}
        return CheckLimits(
            joint_margin_rad=self.joint_margin_deg * DEG,
            wrist_rad=self.wrist_singularity_deg * DEG,
            acceleration_m_s2=controller.acceleration_m_s2,
            least_block_s=controller.least_block_s,
            clearance_m=self.clearance_mm * MM,
            joint_speeds_rad_s=robot.joint_speeds_rad_s if speeds is None else np.array(speeds) * DEG,
            joint_accelerations_rad_s2=robot.joint_accelerations_rad_s2
            if accelerations is None
            else np.array(accelerations) * DEG,
            cables_rad={axis: angle * DEG for axis, angle in cables.items() if angle is not None},
            look_ahead=controller.look_ahead_blocks,
            blending_m=controller.blending_m,
            orientation_rad_s=(RobotSettings.orientation_deg_s if turning is None else turning) * DEG,
            reversal_error_m=self.reversal_error_um * UM,
            correction_m=self.correction_mm * MM,
            correction_rad=self.correction_deg * DEG,
            corner_error_m=None if self.corner_error_um is None else self.corner_error_um * UM,
            assumed=frozenset(assumed | ({"limits.orientation_speed_deg_s"} if turning is None else set())),
        )

    @property
    def limits(self) -> CorrectionLimits:
        """The same, as planning takes them."""
        return CorrectionLimits(
            correction_m=self.correction_mm * MM,
            rotation_rad=self.correction_deg * DEG,
            joint_margin_rad=self.joint_margin_deg * DEG,
            wrist_rad=self.wrist_singularity_deg * DEG,
        )
