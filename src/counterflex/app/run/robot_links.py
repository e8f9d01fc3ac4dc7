"""The link to the robot that a run was told of: RSI by its configuration, EGM by the cell file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.robot_axes import axes_in
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.egm import EgmTable
from counterflex.files.cell.online import OnlineTable
from counterflex.geometry import pose
from counterflex.path.stream import PoseStream
from counterflex.path.toolpath import tool_orientation
from counterflex.plan.plan import Plan
from counterflex.protocols.abb_egm.guidance_link import EgmGuidanceLink, commanded_poses
from counterflex.protocols.abb_egm.path_link import EgmPathLink
from counterflex.protocols.kuka_rsi.config import read_config
from counterflex.protocols.kuka_rsi.link import RsiLink
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.runtime.settings import OnlineSettings, Output

_RSI_MS = (4, 12)


def rsi_link(
    config: Path,
    online: OnlineSettings,
    host: str,
    port: int | None,
    peer: tuple[str, int] | None = None,
    *,
    overriding: bool = False,
    currents: bool = False,
    axes: ControllerAxes = AS_MODEL,
) -> RsiLink:
    """Open the link of an ETHERNET configuration file.

    Args:
        config: The file.
        online: Settings of the loop.
        host: Address to listen on.
        port: None takes the one of the configuration.
        peer: The controller, or None.
        overriding: The loop changes the speed of the program, and uses the changed one.
        currents: The loop reads motor currents.
        axes: How the controller counts the axes.

    Raises:
        FileFormatError: The file cannot be used.
        InputError: RSI has no such cycle, or the configuration does not take in what the loop sends.
        OutputError: The port cannot be bound.
    """
    if round(online.period_s * 1e3) not in _RSI_MS:
        raise InputError("cycle of RSI", value=f"{online.period_s * 1e3:g} ms", limit="4 or 12 ms: [online] period_ms")
    link = RsiLink(read_config(config), host=host, port=port, peer=peer, period_s=online.period_s, axes=axes)
    by_axes = online.output == Output.AXES
    missing, hint = "", ""
    if by_axes and not link.axis_specific:
        missing, hint = "no axis corrections", 'Add AKorr.A1 to AKorr.A6 (AXISCORR), or set output = "cartesian"'
    elif not by_axes and not link.cartesian:
        missing, hint = "no Cartesian correction", 'Add RKorr.X to RKorr.C (POSCORR), or set output = "axes"'
    elif overriding and not link.overriding:
        missing, hint = "no speed of the program", "Add the tag Override, or leave the table [override] out"
    if missing:
        link.close()
        raise InputError(f"the RSI configuration takes in {missing}", where=str(config), hint=hint)
    if currents and not link.has_currents:
        link.close()
        raise InputError(
            "the RSI configuration sends no motor currents",
            where=str(config),
            hint="Add DEF_MACur to SEND, or leave out run.currents",
        )
    return link


def egm_link(
    cell: Cell,
    online: OnlineSettings,
    plan: Plan | None,
    *,
    compensated: bool,
    watch_only: bool,
    host: str,
    port: int | None,
    peer: tuple[str, int] | None = None,
) -> EgmPathLink | EgmGuidanceLink:
    """Open the link of the table ``[egm]`` of a cell.

    Args:
        cell: See there.
        online: Settings of the loop.
        plan: Of the program; guidance streams its path.
        compensated: The path that is streamed contains the plan's correction.
        watch_only: The loop will not be armed.
        host: Address to listen on.
        port: None takes the one of the table.
        peer: The controller, or None.

    Raises:
        InputError: EGM cannot do what the loop wants, or there is no plan to stream.
        OutputError: The port cannot be bound.
    """
    table = cell.tables.egm or EgmTable()
    table.require(cell.tables.online or OnlineTable(), str(cell.path))
    if cell.tables.override is not None and table.mode == "path":
        raise InputError(
            "path correction cannot change the speed of the program",
            where=str(cell.path),
            value="[override]",
            hint='Leave the table [override] out, or set [egm] mode = "pose"',
        )
    T_part_frame = None if table.frame == "part" else pose.inverse(cell.T_base_part)
    where: dict[str, Any] = {
        "host": host,
        "port": table.port if port is None else port,
        "peer": peer,
        "T_part_frame": T_part_frame,
        "axes": axes_in(cell, "rapid")[0],
    }
    if table.mode == "path":
        return EgmPathLink(watch_only=watch_only, period_s=online.period_s, **where)
    if plan is None:
        raise InputError(
            "position guidance streams the planned path, but no plan is given",
            where=str(cell.path),
            hint='Give --plan FILE, or set [egm] mode = "path"',
        )
    stream = planned_stream(cell, plan, online.period_s, compensated=compensated)
    return EgmGuidanceLink(stream, table.guidance(online.delays.correction_s, watch_only=watch_only), **where)


def planned_stream(cell: Cell, plan: Plan, period_s: float, *, compensated: bool) -> PoseStream:
    """The path of a plan as it is streamed to the robot.

    Args:
        cell: Cell; its tables ``[egm]`` and ``[controller]`` say how corners are run.
        plan: Of the program.
        period_s: Cycle.
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
