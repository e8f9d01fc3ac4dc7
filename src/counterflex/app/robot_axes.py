"""Axes and frames of a cell's robot as its controller shows them, by the language of its programs."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.geometry import pose
from counterflex.programs.gcode.write.written_line import number
from counterflex.robot.elasticity.chain import forward
from counterflex.robot.model.controller_axes import MAKERS, ControllerAxes, in_language, turns_zyx, wrapped


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
    title = next((one.title for _, one in MAKERS.items() if one.language == language), "")
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
        q: (6,) rad, angles of the model.
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
    floor = all(maker.world == "floor" for _, maker in MAKERS.items() if maker.language == language)
    T_root_a = T_base_a if floor else axes_in(cell, language)[0].in_world(T_base_a)
    out: Float = T_world_root @ T_root_a
    return out


def tcp_of_axes(cell: Cell, language: str, axes_rad: Float) -> Float:
    """(..., 4, 4) m, pose of the TCP in the robot's base for axes as a program of a language says them.

    Args:
        axes_rad: (..., 6) rad.
    """
    return forward(cell.controller_chain, axes_in(cell, language)[0].model(axes_rad))


def part_in_world(cell: Cell, language: str) -> Float:
    """(4, 4) m, the part frame as the controller gives it; identity where the robot holds the part."""
    return pose.make() if cell.holds_part else in_world(cell, language, cell.T_frame_part)


def pose_text(T_a_b: Float) -> str:
    """``X .., Y .., Z .., A .., B .., C ..`` of a pose (4, 4) m: mm, and deg about z, y', x''."""
    lengths = {c: number(float(v), 4) for c, v in zip("XYZ", T_a_b[:3, 3] / MM, strict=True)}
    angles = {c[0]: number(float(v), 5) for c, v in turns_zyx(T_a_b[:3, :3]).items()}
    return ",".join(f"{c} {text}" for c, text in (lengths | angles).items())
