"""The link of a run to an ABB robot: EGM by the cell file."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from counterflex.app.robot_axes import axes_in
from counterflex.app.run.robot_links import LinkOrder, RobotLinkKind
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.links import EgmTable
from counterflex.files.cell.online import OnlineTable
from counterflex.geometry import pose
from counterflex.integrations.abb.link.guidance_link import EgmGuidanceLink, GuidanceSettings, commanded_poses
from counterflex.integrations.abb.link.link import EgmForce, EgmLink
from counterflex.integrations.abb.link.path_link import EgmPathLink
from counterflex.path.path_speed import PoseStream
from counterflex.path.toolpath import tool_orientation
from counterflex.plan.plan import Plan
from counterflex.runtime.state.supervisor import State


def egm_link(order: LinkOrder) -> EgmPathLink | EgmGuidanceLink:
    """Open the link of the table ``[egm]`` of a cell.

    Raises:
        InputError: EGM cannot do what the loop wants, or there is no plan to stream.
        OutputError: The port cannot be bound.
    """
    cell, online = order.cell, order.online
    if order.currents:
        raise InputError(
            "EGM sends no motor currents", where=str(cell.path), value="run.currents", hint="Leave out run.currents"
        )
    table = cell.tables.egm or EgmTable()
    table.require(cell.tables.online or OnlineTable(), str(cell.path))
    if cell.tables.override is not None and table.mode == "path":
        raise InputError(
            "path correction cannot change the speed of the program", where=str(cell.path), value="[override]",
            hint='Leave the table [override] out, or set [egm] mode = "pose"',
        )  # fmt: skip
    T_part_frame = None if table.frame == "part" else pose.inverse(cell.T_base_part)
    where: dict[str, Any] = {
        "host": order.host,
        "port": table.port if order.port is None else order.port,
        "peer": order.peer,
        "T_part_frame": T_part_frame,
        "axes": axes_in(cell, "rapid")[0],
    }
    if table.mode == "path":
        return EgmPathLink(watch_only=order.watch_only, period_s=online.period_s, **where)
    if order.plan is None:
        raise InputError(
            "position guidance streams the planned path, but no plan is given",
            where=str(cell.path),
            hint='Give --plan FILE, or set [egm] mode = "path"',
        )
    stream = planned_stream(cell, order.plan, online.period_s, compensated=order.compensated)
    guidance = GuidanceSettings(
        lag_s=online.delays.correction_s,
        start=State.IDLE if order.watch_only else State.ARMED,
        tolerance_m=table.start_tolerance_mm * MM,
        tolerance_rad=table.start_tolerance_deg * DEG,
        follow_m=table.follow_mm * MM,
        speed_reference=table.speed_reference,
    )
    return EgmGuidanceLink(stream, guidance, **where)


def planned_stream(cell: Cell, plan: Plan, period_s: float, *, compensated: bool) -> PoseStream:
    """The path of a plan as it is streamed to the robot.

    Args:
        cell: Cell; its tables ``[egm]`` and ``[controller]`` say how corners are run.
        compensated: With the plan's correction.
    """
    table = cell.tables.egm or EgmTable()
    contained: Float = np.concatenate([plan.correction_part, plan.rotvec_part], axis=1)
    if not compensated:
        contained = np.zeros_like(contained)
    Rs_part_tcp = tool_orientation(plan.path.axis_part, cell.tables.posture.rotations_rad(plan.path.p_part_tcp))
    return PoseStream(
        commanded_poses(Rs_part_tcp, plan.path.p_part_tcp, contained),
        plan.path,
        period_s=period_s,
        acceleration_m_s2=table.acceleration_mm_s2 * MM,
        blending_m=table.blending_mm * MM,
        rapid_m_s=cell.tables.controller.rapid_m_s,
    )


def _own_force(link: EgmLink, range_n: float | None, range_nm: float | None) -> EgmForce:
    return EgmForce(link, range_n=range_n, range_nm=range_nm)


LINK: Final = RobotLinkKind(
    title="ABB EGM",
    how="--egm for an ABB robot",
    open=egm_link,
    own_force=_own_force,
    simulated="counterflex.integrations.abb.alone:controller",
    alone="counterflex.integrations.abb.alone:alone",
)
