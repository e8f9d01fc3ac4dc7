"""The instrumented spindle holder as the force of a run: its constants from the cell file, and how certain it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MICRO, MM
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.sensing import HolderTable, strain_holder
from counterflex.geometry import pose
from counterflex.plan.plan import Plan
from counterflex.protocols.session.senses import ProcessWrench
from counterflex.protocols.session.strain_tare import StrainTare
from counterflex.protocols.session.tool_change import ToolChange
from counterflex.protocols.strain.link import StrainLink
from counterflex.runtime.sensing.pair_wrench import PairWrench
from counterflex.runtime.sensing.strain_wrench import ObserverTuning, StrainWrench
from counterflex.runtime.settings import OnlineSettings
from counterflex.sensing.carrier import carrier_pose, carrier_to_tcp, mass_behind
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.sensing.strain_holder import StrainHolder, force_matrix, tool_matrix


def tool_tips(cell: Cell, sensor: FlangeSensor) -> dict[int, Float]:
    """Tip (3,) m of each tool in the frame of what measures the force: that of the cell, ``longer_mm`` further out.

    Args:
        cell: Its ``[[tools]]``.
        sensor: Flange sensor, or what hangs behind the holder.
    """
    T = pose.inverse(sensor.T_seg_sensor) @ carrier_to_tcp(cell.chain, sensor.segment)
    return {tool.number: T[:3, 3] + tool.longer_mm * MM * T[:3, 2] for tool in cell.tables.tools}


def tool_loads(cell: Cell, sensor: FlangeSensor) -> Mapping[int, tuple[float, Float]]:
    """Mass and centre of gravity (3,) m behind the sensor with each tool: ``heavier_kg`` more, at its tip.

    Args:
        cell: Its ``[[tools]]``.
        sensor: Load that was identified, with the usual tool.
    """
    tips = tool_tips(cell, sensor)
    loads = {}
    for tool in cell.tables.tools:
        mass = sensor.mass_kg + tool.heavier_kg
        moment = sensor.mass_kg * sensor.p_sensor_com + tool.heavier_kg * tips[tool.number]
        loads[tool.number] = (mass, moment / mass if mass > 0.0 else np.zeros(3))
    return loads


def tools_of(
    plan: Plan | None, cell: Cell, sensor: FlangeSensor | None, wrench: ProcessWrench | None
) -> ToolChange | None:
    """Return the follower of the tools of a plan that cuts with several; None where one cuts all.

    Args:
        plan: Of the program, or None.
        cell: Its ``[[tools]]``.
        sensor: What measures the force, or None.
        wrench: What makes a process wrench of it, or None.
    """
    if plan is None or len(np.unique(plan.path.tool[plan.cutting])) < 2:
        return None
    return ToolChange(plan.path.tool.astype(np.int64), plan.cutting, user(cell, sensor, wrench))


def user(cell: Cell, sensor: FlangeSensor | None, wrench: ProcessWrench | None) -> Callable[[int], None]:
    """User of the constants of a tool by its number: weight, and with the holder its matrix and lever."""
    loads = {} if sensor is None else tool_loads(cell, sensor)

    def use(number: int) -> None:
        if wrench is None or isinstance(wrench, PairWrench) or number not in loads:
            return
        wrench.carry(*loads[number])
        if isinstance(wrench, StrainWrench):
            wrench.use(number)

    return use


APART_M: Final = 5.0 * MM
"""Most by which the tool tip of ``[holder]`` and that of the chain may differ."""
SINCE_S: Final = 60.0
"""Time since the zeros were taken for which the uncertainty of the force is stated."""
_SAMPLES: Final = 4  # Readings in a cycle of the loop at the usual rate
_WINDOW_S, _LEAST_SLEW_N = 0.1, 60.0
_MARGIN: Final = 1.5  # By how much faster than planned a force is expected to change
_SIGMAS: Final = 3.0


def holder_of(cell: Cell) -> tuple[HolderTable, StrainHolder]:
    """Table and constants of the holder that a run takes its force from.

    Raises:
        FileFormatError: The cell has none that was identified and sits in its chain.
        InputError: It sits elsewhere than its table says.
    """
    table, holder = cell.tables.holder, strain_holder(cell.tables.holder)
    where = str(cell.path)
    if table is None or holder is None:
        raise FileFormatError(
            'force_from = "holder" needs a table [holder]', where=where, hint='Or set force_from = "sensor" in [online]'
        )
    if not table.sensitivity_um_m_per_kn:
        raise FileFormatError(
            "the bridges of the holder are known from the drawing only",
            where=where,
            value="no sensitivity_um_m_per_kn in [holder]",
            hint="counterflex identify holder measures them; a drawing is off by up to 65 %",
        )
    if not holder.segment:
        raise FileFormatError(
            "where the holder sits is not said",
            where=where,
            value="no segment in [holder]",
            limit=", ".join(body.name for body in cell.end_effector.segments),
            hint="segment names the body of the end effector whose frame is the holder's",
        )
    p_chain = carrier_to_tcp(cell.chain, holder.segment)[:3, 3]
    distance = float(np.linalg.norm(p_chain - holder.p_holder_tcp))
    if distance > APART_M:
        raise InputError(
            "the tool tip of [holder] is not that of [tcp]",
            where=where,
            value=f"tcp_mm = {np.round(holder.p_holder_tcp / MM, 1).tolist()}",
            limit=f"{np.round(p_chain / MM, 1).tolist()} mm by the chain, within {APART_M / MM:g} mm",
        )
    return table, holder


def force_sigma(table: HolderTable, holder: StrainHolder, p_holder_tcp: Float, since_s: float = SINCE_S) -> Float:
    """(3,) N standard deviation of the force by direction, holder axes, some time after the zeros were taken.

    ``M (N / k + W t) M^T``: noise of the readings of a cycle, and the walk of the zeros, of which the part that looks
    like a force is not seen. What grows with the force is :attr:`HolderTable.error_share`.
    """
    noise = np.diag(holder.noise**2)
    M = force_matrix(tool_matrix(holder.sensitivity, p_holder_tcp), noise)
    walk = (table.wander_um_m * MICRO) ** 2 * since_s
    out: Float = np.sqrt(np.diag(M @ (noise / _SAMPLES + walk * np.eye(len(noise))) @ M.T))
    return out


def with_uncertainty(settings: OnlineSettings, cell: Cell) -> OnlineSettings:
    """Limits of the tests of the force, widened by what the holder leaves uncertain of it.

    Force in the air, and a step of the measured less the planned force: three standard deviations more, of the worst
    direction, because they judge the length of the force. The noise that the factors of the force are estimated with is
    at least that standard deviation.

    Raises:
        FileFormatError: As :func:`holder_of`.
        InputError: Likewise.
    """
    table, holder = holder_of(cell)
    sigma = float(np.max(force_sigma(table, holder, carrier_to_tcp(cell.chain, holder.segment)[:3, 3])))
    tests = settings.plausibility
    wider = replace(tests, idle_n=tests.idle_n + _SIGMAS * sigma, step_n=tests.step_n + _SIGMAS * sigma)
    return replace(settings, plausibility=wider, force_noise_n=float(np.hypot(settings.force_noise_n, sigma)))


def planned_slew(plan: Plan, cell: Cell, segment: str) -> tuple[float, float, float]:
    """(3,) N per root second, holder axes: the fastest change of the planned force over 0.1 s, and half as much more.

    Args:
        segment: Body whose frame is the holder's; its rotation is that at the largest force.
    """
    force, time = plan.w_tcp_part[:, :3], plan.path.time_s
    hardest = plan.q[int(np.argmax(np.linalg.norm(force, axis=1)))]
    R_base_holder = carrier_pose(cell.chain, segment, hardest, elastic=False)[:3, :3]
    even = np.arange(time[0], time[-1] + 2.0 * _WINDOW_S, 0.1 * _WINDOW_S)
    sampled = np.stack([np.interp(even, time, f) for f in force.T], axis=1)
    change = (sampled[10:] - sampled[:-10]) @ cell.T_base_part[:3, :3].T @ R_base_holder
    slew = _MARGIN * np.abs(change).max(axis=0, initial=0.0) / np.sqrt(_WINDOW_S)
    x, y, z = np.maximum(slew, _LEAST_SLEW_N)
    return float(x), float(y), float(z)


def tuning_of(table: HolderTable, holder: StrainHolder, plan: Plan | None, cell: Cell) -> ObserverTuning:
    """Return the tuning of the holder's filter: that of the cell file, else by the plan."""
    usual = ObserverTuning()
    slew = table.slew_n
    if slew is None:
        slew = usual.slew_n if plan is None else planned_slew(plan, cell, holder.segment)
    return replace(usual, slew_n=slew, wander=table.wander_um_m * MICRO, most_sigma_n=table.most_sigma_n)


def carried_load(cell: Cell, segment: str) -> FlangeSensor:
    """Load behind the holder as a sensor there would feel it: mass, centre of gravity, frame of the holder."""
    mass_kg, p_seg_com = mass_behind(cell.chain, segment)
    return FlangeSensor(segment, np.eye(4), mass_kg, p_seg_com)


def open_holder(
    cell: Cell, plan: Plan | None, host: str, port: int, force_n: float, moment_nm: float
) -> tuple[StrainLink, StrainWrench, StrainTare]:
    """Receiver of the strains, the filter that makes a force of them, and how its zeros are taken.

    Args:
        cell: With a table ``[holder]``.
        plan: Of the program, or None.
        host: Address to listen on.
        port: UDP port of the strain datagrams.
        force_n: Largest force that a sensor may show without a cut, see
            :class:`counterflex.protocols.session.session.SessionChecks`.

    Raises:
        FileFormatError: As :func:`holder_of`.
        InputError: Likewise, or the bridges do not determine a direction.
        OutputError: The port cannot be opened.
    """
    table, holder = holder_of(cell)
    tuning = tuning_of(table, holder, plan, cell)
    link = StrainLink(host, port, len(holder.gauges), range_=table.range_um_m * MICRO, least=tuning.least)
    load = carried_load(cell, holder.segment)
    wrench = StrainWrench(
        cell.chain,
        holder,
        cell.T_base_part,
        (link.strain, link.warm_c, link.times_ns, link.counts),
        link.w_sensor,
        load=(load.mass_kg, load.p_sensor_com),
        error=table.error_share,
        tools=tool_tips(cell, load),
        tuning=tuning,
    )
    return link, wrench, StrainTare(wrench, force_n, moment_nm, table.zero_um_m * MICRO)
