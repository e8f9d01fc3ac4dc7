"""The robot that the tables of a cell file describe: model, own geometry or URDF, with what the file changes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.core.units import DEG, MM, MRAD, MS, URAD
from counterflex.files.cell.located import located
from counterflex.files.cell.measured import CalibrationTable
from counterflex.files.cell.robot import OpwTable, axis_2_height
from counterflex.files.cell.tables import CellTables
from counterflex.robot.model import catalog, opw_chain
from counterflex.robot.model.controller_axes import AS_MODEL, from_geometry, maker_of
from counterflex.robot.model.description import Opw, Play, Robot, Servo


def robot_of(tables: CellTables, path: Path) -> Robot:
    """The robot, not calibrated.

    Args:
        path: Of the file, for the files that it names and for faults.
    """
    robot = _with_axes(_robot(tables, path), tables, str(path))
    robot = _with_drives(_with_elastic(robot, tables, str(path)), tables)
    regions = (*robot.regions, *(row.region() for row in tables.robot.elastic_region))
    return replace(robot, regions=regions, curves=tuple(row.curve() for row in tables.robot.compliance_curve))


def _robot(tables: CellTables, path: Path) -> Robot:
    table = tables.robot
    if table.catalog is not None:
        with located(f"{path}: robot.catalog"):
            return catalog.load(table.catalog)
    if table.geometry is not None:
        with located(f"{path}: robot.geometry"):
            return _own_robot(table.geometry, tables.name)
    if table.dh is not None:
        with located(f"{path}: robot.dh"):
            return table.dh.robot(tables.name)
    from counterflex.robot.model import urdf  # heavy, optional dependency

    with located(f"{path}: robot.urdf"):
        return urdf.load_urdf(path.parent / str(table.urdf), tip_link=table.urdf_tip)


def _with_axes(robot: Robot, tables: CellTables, where: str) -> Robot:
    """The robot with the axes of its controller; ``limits_deg`` of the file are those of the controller."""
    table = tables.robot
    if table.catalog is not None:
        return robot
    axes = AS_MODEL
    if table.controller_axes is not None:
        with located(f"{where}: robot.controller_axes"):
            axes = table.controller_axes.axes(robot)
    elif robot.opw is not None:
        maker = maker_of(robot.opw.signs, robot.opw.offsets_rad)
        if maker is not None:
            axes = from_geometry(maker, robot.opw.signs, robot.opw.offsets_rad, robot.opw.c1_m)
    elif table.dh is not None:
        axes = replace(AS_MODEL, assumed=_DH_AXES, axis_2_m=axis_2_height(robot))
    if table.urdf is not None or axes.matrix is None:
        return replace(robot, axes=axes)
    given = None if table.controller_axes is None else table.controller_axes.axis_3_to_upper_arm_deg
    between = None if given is None else np.array(given) * DEG
    axes = replace(axes, limits_rad=robot.joint_limits_rad, between_known=given is not None)
    box = axes.model_limits(between)
    if np.any(box[:, 0] >= box[:, 1]):
        raise FileFormatError(
            "no angle of axis 3 is within its limits", where=f"{where}: robot.controller_axes.axis_3_to_upper_arm_deg",
            value=f"{given}",
        )  # fmt: skip
    return replace(robot, axes=axes, joint_limits_rad=box)


_DH_AXES = (
    "axes are taken as the rows of robot.dh describe them; say maker, signs and zeros_deg in [robot.controller_axes]"
)


def _with_elastic(robot: Robot, tables: CellTables, where: str) -> Robot:
    segments = {segment.name: segment for segment in robot.segments}
    for row in tables.robot.elastic:
        if row.segment not in segments:
            raise FileFormatError(
                f"the robot has no segment '{row.segment}'", where=f"{where}: robot.elastic", limit=", ".join(segments)
            )
        old = segments[row.segment]
        compliance = row.over(old.compliance)
        mass = old.mass_kg if row.mass_kg is None else row.mass_kg
        segments[row.segment] = replace(old, compliance=compliance, mass_kg=mass)
    return replace(robot, segments=tuple(segments[segment.name] for segment in robot.segments))


def _with_drives(robot: Robot, tables: CellTables) -> Robot:
    """Play, friction and loop gains of the axes that the file gives them for."""
    play, servo = list(robot.play or (None,) * 6), list(robot.servo or (None,) * 6)
    for row in tables.robot.play:
        slip = tuple(angle * URAD for angle in row.slip_urad)
        play[row.axis - 1] = Play(row.dead_band_half_urad * URAD, row.friction_nm, slip)
    for gains in tables.robot.servo:
        servo[gains.axis - 1] = Servo(
            speed_gain_nm_s=gains.speed_gain_nm_s,
            position_gain_per_s=gains.position_gain_per_s,
            integral_time_s=gains.integral_time_ms * MS,
            friction_nm=gains.friction_nm,
            slip_rad=gains.slip_urad * URAD,
        )
    return replace(
        robot, play=tuple(play) if any(play) else robot.play, servo=tuple(servo) if any(servo) else robot.servo
    )


def _own_robot(table: OpwTable, name: str) -> Robot:
    opw = Opw(
        a1_m=table.a1_mm * MM,
        a2_m=table.a2_mm * MM,
        b_m=table.b_mm * MM,
        c1_m=table.c1_mm * MM,
        c2_m=table.c2_mm * MM,
        c3_m=table.c3_mm * MM,
        c4_m=table.c4_mm * MM,
        offsets_rad=tuple(angle * DEG for angle in table.offsets_deg),
        signs=tuple(table.signs),
    )
    return opw_chain.from_opw(name, opw, np.array(table.limits_deg) * DEG)


def calibration_of(tables: CellTables) -> dict[str, Float]:
    """(6,) m, rad: displacement behind each calibrated segment, by its name."""
    return {
        row.segment: np.array([*(np.array([row.x_mm, row.y_mm, row.z_mm]) * MM), *(_turn(row) * MRAD)])
        for row in tables.robot.calibration
    }


def _turn(row: CalibrationTable) -> Float:
    return np.array([row.rx_mrad, row.ry_mrad, row.rz_mrad])
