"""The cell as identification sees it: what its file says before the measurement, in SI."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from counterflex.core.arrays import Float
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.description import EndEffector, Robot


@dataclass(frozen=True, eq=False)
class CellModel:
    """A cell before identification."""

    name: str  # of the cell
    robot: Robot  # as the cell file has it, earlier calibrations applied
    end_effector: EndEffector  # likewise
    nominal_robot: Robot  # as the robot controller has it, without calibrations
    nominal_end_effector: EndEffector  # likewise
    calibration: Mapping[str, Float]  # earlier calibration by segment, (6,) displacements; empty where there is none
    law_of: Callable[[], ForceLaw]  # gives the force law of the material; raises where the cell file has no material
    cutter_of: Callable[[int], Cutter]  # the tool with a program's number
    # gives the (4, 4) part frame in the robot base; raises where the cell file has no part
    frame_of: Callable[[], Float]
    branch: str  # posture, one of counterflex.robot.model.opw.BRANCHES
    joint_margin_rad: float  # distance that measurements keep from the joint limits
    rotation_about_tool_rad: float = 0.0  # free rotation about the tool axis that programs are run with
    # (2, 3) m, low and high corner of the blank in the part frame, None where it is no box
    blank_part: Float | None = None
    # (k, 3) m, points that the robot touches to find the part; None where another instrument finds it
    datum_points_part: Float | None = None
    # tables `sensor`, `holder`, `tracker`, `timing` of the cell file as plain values where present
    tables: Mapping[str, Any] = field(default_factory=dict)

    @property
    def force_law(self) -> ForceLaw:
        """Force law of the material. Raises FileFormatError where the cell file has none."""
        return self.law_of()

    @property
    def T_base_part(self) -> Float:
        """(4, 4) part frame in the robot base. Raises FileFormatError where the cell file has none."""
        return self.frame_of()

    @property
    def chain(self) -> ElasticChain:
        """Robot and end effector as one elastic chain, built anew at every call."""
        return ElasticChain.build(self.robot, self.end_effector)

    @property
    def nominal_chain(self) -> ElasticChain:
        """The same without calibrations: what the robot controller computes with."""
        return ElasticChain.build(self.nominal_robot, self.nominal_end_effector)
