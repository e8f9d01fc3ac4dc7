"""Axes and frames of a cell's robot as its controller shows them, by the language of its programs."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.robot.model.controller_axes import MAKERS, ControllerAxes, in_language, wrapped


def axes_in(cell: Cell, language: str) -> tuple[ControllerAxes, tuple[str, ...]]:
    """Axes as a controller that runs programs of a language shows them, and what was taken without being said.

    Raises:
        InputError: Nothing says how the controller counts the axes of this robot.
    """
    robot = cell.nominal_robot
    return in_language(robot.axes, robot.opw, robot.joint_limits_rad, language, str(cell.path))


def axes_of_posture(cell: Cell, language: str, q: Float) -> list[float]:
    """Axes of a posture as a program of a language says them.

    Args:
        cell: The cell.
        language: Of the program.
        q: (6,) rad, angles of the model.

    Raises:
        InputError: See :func:`axes_in`.
    """
    axes, _ = axes_in(cell, language)
    shown = axes.shown(q)
    if axes.maker != cell.nominal_robot.axes.maker:
        shown = wrapped(shown)
    return [float(angle) for angle in shown]


def in_world(cell: Cell, language: str, T_base_a: Float) -> Float:
    """(4, 4) m, a frame given in the robot's base as a controller gives it: in its world.

    The world of a FANUC or Staubli controller lies at the height of axis 2, the one of a KUKA or ABB controller on the
    base plate; ``[controller.robot_in_world]`` says where the robot stands in it.

    Raises:
        InputError: The world depends on the robot, and nothing says how: see :func:`axes_in`.
    """
    stands = cell.tables.controller.robot_in_world
    T_world_root = np.eye(4) if stands is None else stands.matrix()
    floor = all(maker.world == "floor" for maker in MAKERS.values() if maker.language == language)
    T_root_a = T_base_a if floor else axes_in(cell, language)[0].in_world(T_base_a)
    out: Float = T_world_root @ T_root_a
    return out


def tcp_of_axes(cell: Cell, language: str, axes_rad: Float) -> Float:
    """(..., 4, 4) m, pose of the TCP in the robot's base for axes as a program of a language says them.

    Args:
        cell: The cell.
        language: Of the program.
        axes_rad: (..., 6) rad.

    Raises:
        InputError: See :func:`axes_in`.
    """
    from counterflex.robot.elasticity.chain import forward

    return forward(cell.controller_chain, axes_in(cell, language)[0].model(axes_rad))


def part_in_world(cell: Cell, language: str) -> Float:
    """(4, 4) m, the part frame as the controller gives it; identity where the robot holds the part."""
    return pose.make() if cell.holds_part else in_world(cell, language, cell.T_base_part)
