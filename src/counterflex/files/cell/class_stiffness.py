"""Robots of which no stiffness is known: which axes that are, and what their class gives them when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.units import MM
from counterflex.files.cell.robot import RobotTable
from counterflex.robot.elasticity.axis_springs import rigid_axes
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model import catalog
from counterflex.robot.model.class_prior import ClassPrior, class_prior
from counterflex.robot.model.description import Robot

_ABOUT_Z = 5
_TURNS = ("rx_urad_per_knm", "ry_urad_per_knm", "rz_urad_per_knm")


@dataclass(frozen=True)
class ClassStiffness:
    """Stiffness that a robot has been given by its class."""

    axes: tuple[int, ...]  # Numbers 0..5 of the axes that nothing was known of
    prior: ClassPrior

    @property
    def named(self) -> str:
        """The axes, for messages: ``A1, A2``."""
        return axis_names(self.axes)


def axis_names(axes: tuple[int, ...]) -> str:
    """Axes 0..5 as a shop says them: ``A1, A2``."""
    return ", ".join(f"A{axis + 1}" for axis in axes)


def unknown_axes(robot: Robot, table: RobotTable) -> tuple[int, ...]:
    """Axes that have no stiffness, and of which the cell file does not say that they are rigid.

    Args:
        robot: With the cell file's changes to its elastic elements.
        table: Of the cell file: a row of ``[[robot.elastic]]`` that gives an axis a rotation, 0 included, states it.

    Returns:
        Numbers 0..5, rising.
    """
    stated = {row.segment for row in table.elastic if any(getattr(row, key) is not None for key in _TURNS)}
    axes = {segment.joint: segment.name for segment in robot.segments if segment.joint is not None}
    chain = ElasticChain.build(replace(robot, regions=()))  # regions may name bodies of the end effector
    return tuple(axis for axis in rigid_axes(chain) if axes[axis] not in stated)


def prior_of(robot: Robot, table: RobotTable) -> ClassPrior:
    """Return what the class of a robot says about its stiffness.

    Raises:
        InputError: Its payload is not known, or no robot of its size has a published stiffness.
    """
    payload, reach_mm = table.payload_kg, None
    if table.catalog is not None:
        entry = catalog.entry(table.catalog)
        payload, reach_mm = payload or entry.payload_kg, entry.reach_mm
    return class_prior(payload, _reach_m(robot) if reach_mm is None else reach_mm * MM)


def _reach_m(robot: Robot) -> float:
    """Distance of the wrist centre from axis 1 with the arm stretched out; of other arms the lengths added up."""
    if robot.opw is not None:
        return robot.opw.a1_m + robot.opw.c2_m + float(np.hypot(robot.opw.a2_m, robot.opw.c3_m))
    return float(sum(np.linalg.norm(segment.T_prev_seg[:3, 3]) for segment in robot.segments[1:]))


def with_class_stiffness(robot: Robot, given: ClassStiffness) -> Robot:
    """The robot with the median of its class about the axes that nothing is known of."""
    segments = []
    for segment in robot.segments:
        if segment.joint in given.axes:
            compliance = np.array(segment.compliance)
            compliance[_ABOUT_Z] = 1.0 / given.prior.median_nm_per_rad[segment.joint]
            segments.append(replace(segment, compliance=compliance))
        else:
            segments.append(segment)
    return replace(robot, segments=tuple(segments))
