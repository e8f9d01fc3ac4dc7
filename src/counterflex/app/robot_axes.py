"""Axes and frames of a cell's robot as its controller shows them, by the language of its programs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.model.controller_axes import MAKERS, ControllerAxes, in_language, wrapped
from counterflex.robot.model.opw import TURN


def axes_in(cell: Cell, language: str) -> tuple[ControllerAxes, tuple[str, ...]]:
    """Axes as a controller that runs programs of a language shows them, and what was taken without being said.

    Raises:
        InputError: Nothing says how the controller counts the axes of this robot.
    """
    robot = cell.nominal_robot
    return in_language(robot.axes, robot.opw, robot.joint_limits_rad, language, str(cell.path))


def other_maker(cell: Cell, language: str) -> str:
    """Return why the controller of the cell's robot does not run a language of robots; empty where it may."""
    maker = cell.nominal_robot.axes.maker
    title = next((one.title for one in MAKERS.values() if one.language == language), "")
    if not title or maker is None or MAKERS[maker].language == language:
        return ""
    return f"the program is for a controller of {title}, the robot is of {MAKERS[maker].title}"


def remarks(cell: Cell, language: str) -> tuple[str, ...]:
    """Return what a writer that needs no axes says of the controller: see :func:`axes_in`."""
    try:
        return axes_in(cell, language)[1]
    except InputError as error:
        return (f"{error.what}: no axes are written",)


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

    The world of a FANUC or Staubli robot lies at the height of axis 2, the one of a KUKA or ABB robot on the base
    plate; ``[controller.robot_in_world]`` says where the robot stands in it.

    Raises:
        InputError: The world depends on the robot, and nothing says how: see :func:`axes_in`.
    """
    stands = cell.tables.controller.robot_in_world
    T_world_root = np.eye(4) if stands is None else stands.matrix()
    floor = all(maker.world == "floor" for maker in MAKERS.values() if maker.language == language)
    T_root_a = T_base_a if floor else axes_in(cell, language)[0].in_world(T_base_a)
    out: Float = T_world_root @ T_root_a
    return out


def fanuc_configuration(branch: str, axes_rad: Sequence[float] | None = None) -> str:
    """CONFIG of FANUC positions in a posture: wrist N F, elbow U D, arm T B, turns of J1, J4 and J6.

    Args:
        branch: Such as ``front up noflip``.
        axes_rad: (6,) axes as the controller shows them; None is no turn.
    """
    arm, elbow, wrist = branch.split()
    letters = ("N" if wrist == "noflip" else "F", "U" if elbow == "up" else "D", "T" if arm == "front" else "B")
    turns = [0, 0, 0] if axes_rad is None else [round(axes_rad[axis] / TURN) for axis in (0, 3, 5)]
    return f"{' '.join(letters)}, {', '.join(str(turn) for turn in turns)}"


def val3_configuration(branch: str) -> tuple[str, str, str]:
    """Shoulder, elbow and wrist of VAL3 points in a posture: by the side of the arm and the signs of J3 and J5."""
    arm, elbow, wrist = branch.split()
    bent = (elbow == "up") == (arm == "front")
    return (
        "righty" if arm == "front" else "lefty",
        "epositive" if bent else "enegative",
        "wpositive" if wrist == "noflip" else "wnegative",
    )


def tcp_of_axes(cell: Cell, language: str, axes_rad: Float) -> Float:
    """(..., 4, 4) m, pose of the TCP in the robot's base for axes as a program of a language says them.

    Args:
        cell: The cell.
        language: Of the program.
        axes_rad: (..., 6) rad.

    Raises:
        InputError: See :func:`axes_in`.
    """
    return forward(cell.controller_chain, axes_in(cell, language)[0].model(axes_rad))


def part_in_world(cell: Cell, language: str) -> Float:
    """(4, 4) m, the part frame as the controller gives it; identity where the robot holds the part."""
    return pose.make() if cell.holds_part else in_world(cell, language, cell.T_frame_part)
