"""The loop of a cell, built from its files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from counterflex.app.axis_controller import require_margins
from counterflex.app.inputs import setting_of
from counterflex.app.lowest_mode import lowest_mode
from counterflex.app.run.holder import carried_load, holder_of, with_uncertainty
from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import Cell
from counterflex.files.cell.monitor import feed_exponent
from counterflex.files.cell.online import OnlineTable
from counterflex.files.cell.sensing import flange_sensor
from counterflex.geometry import pose
from counterflex.plan.inputs import feed_runs, part_compliance
from counterflex.plan.lowest_mode import mode_of
from counterflex.plan.plan import Plan, across
from counterflex.plan.play_compensation import arm_share, arrival, play_compensation
from counterflex.plan.static_correction import APPROACH_S, within
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitoring.settings import unwatched
from counterflex.runtime.settings import Delays, ForceMode, TrackerMode
from counterflex.sensing.flange_sensor import FlangeSensor
from counterflex.signals.preview import Ahead, Mode

_STIFF = 1e-3  # A direction stiffer than the softest by more than that is not bent for lost motion
_EXPONENT = 0.75  # Of the force in the feed, where there is no plan to take it from


def loop_plan(plan: Plan, cell: Cell, *, compensated: bool) -> LoopPlan:
    """Return the part of a plan that the loop needs.

    Args:
        cell: Its arm, its lowest mode and its delays say what has to be commanded ahead of time.
        compensated: The robot runs the compensated program, so that its points contain the plan's correction.
    """
    sent = np.concatenate([plan.correction_part, plan.rotvec_part], axis=1)
    if not compensated:
        sent = np.zeros_like(sent)
    dynamics = cell.tables.dynamics
    settings = (cell.tables.online or OnlineTable()).settings(cell.tables.timing, compensated=compensated)
    delays = settings.delays
    designed = settings.tracker == TrackerMode.DESIGNED and settings.tuning.undo_play and not compensated
    hardest = plan.q[int(np.argmax(np.linalg.norm(plan.w_tcp_part[:, :3], axis=1)))]
    modes = (mode_of(cell.chain, hardest, dynamics.mode), Mode(delays.natural_per_s, delays.damping))
    shaping = replace(dynamics.shaping, lead_s=delays.dead_s + dynamics.shaping.lead_s)
    on_hand = setting_of(cell, part_may_be_held=True).relative_motion(plan.path).load(plan.w_tcp_part)
    ahead = Ahead(arm_share(cell.chain, plan.q, on_hand), modes, shaping)
    w, w_lost, cutting = plan.w_tcp_part, np.zeros_like(plan.w_tcp_part), plan.cutting.astype(np.float64)
    if not compensated and settings.pilot.lead_s is None:
        if _loses(cell) and settings.force in (ForceMode.PILOT, ForceMode.SCALE):
            w_lost = w_lost if designed or settings.axis_play else _lost(plan, cell)
        if settings.normal_only:
            w, w_lost, cutting = _late(plan, w, w_lost, cutting)
    return LoopPlan(
        p_part=plan.path.p_part_tcp + sent[:, :3],
        time_s=plan.path.time_s,
        w_tcp_part=w,
        cutting=cutting,
        contained=_contained(plan, sent, compensated=compensated),
        undo_play=_play_compensation(plan, cell, delays) if designed else None,
        turn_per_s=np.abs(plan.path.spindle_rad_s) / (2.0 * np.pi),
        tool=plan.path.tool.astype(np.int64),
        chip_m=plan.feed_per_tooth_m * np.sin(0.5 * (plan.entry_rad + plan.exit_rad)),
        need_m=None if compensated else across(-plan.deflection_part[:, :3], plan.path.p_part_tcp),
        residual_m=np.linalg.norm(across(plan.deviation_compensated_part, plan.path.p_part_tcp), axis=1)
        if compensated
        else None,
        w_ahead_part=ahead.command(w, plan.path.time_s, w_lost),
        w_lost_part=w_lost,
        ahead=ahead,
    )


def _loses(cell: Cell) -> bool:
    """Return whether play or loop gains of the drives are known: assumed ones move nothing online."""
    return cell.chain.play is not None or cell.chain.servo is not None


def _contained(plan: Plan, sent: Float, *, compensated: bool) -> Float:
    """(n, 6) m and rad, what the program contains of the correction for the force."""
    out = sent.copy()
    if compensated and plan.measured_part is not None:
        out[:, :3] -= plan.measured_part  # what parts showed moves the nominal: no online cause may take it back
    return out


def _late(plan: Plan, *series: Float) -> list[Float]:
    """Series over the plan's time, at the times at which a robot that bends comes to its points."""
    time = plan.path.time_s
    late = arrival(plan.path.p_part_tcp, time, plan.deflection_part[:, :3])
    columns = [values.reshape(len(time), -1).T for values in series]
    return [
        np.stack([np.interp(time, late, column) for column in one], axis=1).reshape(values.shape)
        for one, values in zip(columns, series, strict=True)
    ]


def _lost(plan: Plan, cell: Cell) -> Float:
    """(n, 6) N, force that would bend the robot as far as its drives yield and lose motion, near contact."""
    setting, path = setting_of(cell, part_may_be_held=True), plan.path
    near = np.flatnonzero(within(plan.cutting, path.time_s, feed_runs(path), APPROACH_S))
    out = np.zeros_like(plan.w_tcp_part)
    if np.any(plan.play_part[near] != 0.0):
        C = part_compliance(setting, setting.relative_motion(path).rows(near), plan.q[near])[:, :3, :3]
        out[near, :3] = (np.linalg.pinv(C, rcond=_STIFF, hermitian=True) @ plan.play_part[near, :, None])[:, :, 0]
    return out


def _play_compensation(plan: Plan, cell: Cell, delays: Delays) -> Float:
    lag = Mode(delays.natural_per_s, delays.damping)
    known = setting_of(cell, chain=cell.chain, part_may_be_held=True)  # as the cell file says, nothing assumed
    return play_compensation(known, plan.path, plan.q, plan.w_tcp_part, lag, delays.dead_s)


def online_loop(cell: Cell, plan: LoopPlan | None, *, compensated: bool) -> Loop:
    """The loop of a cell.

    Raises:
        FileFormatError: The cell has no ``[online]`` table.
        InputError: Its values contradict each other, or need a plan.
    """
    table = cell.tables.online
    if table is None:
        raise FileFormatError(
            "the cell file has no table [online]",
            where=str(cell.path),
            hint='Add a table [online], for example with force = "pilot"',
        )
    mode = lowest_mode(cell)
    settings = table.settings(cell.tables.timing, compensated=compensated, mode=(mode.hz, mode.damping_ratio))
    require_margins(cell, settings)
    held = table.force_from == "holder" and table.force != "none"
    if held:
        settings = with_uncertainty(settings, cell)
    watched, override = cell.tables.monitor, cell.tables.override
    teeth = None
    exponent = _EXPONENT
    if plan is not None and plan.tool is not None:
        flutes = {tool.number: tool.flutes for tool in cell.tables.tools}
        teeth = np.array([flutes.get(int(number), 0) for number in plan.tool], dtype=np.int64)
        if plan.chip_m is not None and np.any(chips := np.isfinite(plan.chip_m) & (plan.chip_m > 0.0)):
            exponent = feed_exponent(cell.force_law, float(np.median(plan.chip_m[chips])))
        plan = replace(plan, teeth=teeth)
    sensor = load_behind(cell)
    inertia_kg = 0.0 if sensor is None or settings.inertia_hz > 0.0 else sensor.mass_kg
    seen_by = unwatched if watched is None else watched.settings
    return Loop(
        cell.chain,
        settings,
        np.eye(4) if cell.holds_part else cell.T_base_part,
        plan,
        monitor=seen_by(settings, exponent, inertia_kg, mode.ring_s),
        override=None if override is None else override.settings(),
        T_base_tcp=cell.T_base_tcp,
    )


def load_behind(cell: Cell) -> FlangeSensor | None:
    """Load behind what measures the force, flange sensor or instrumented holder; None where there is neither."""
    table = cell.tables.online or OnlineTable()
    if table.force_from == "holder":
        return carried_load(cell, holder_of(cell)[1].segment) if table.force != "none" else None
    return flange_sensor(cell.tables.sensor, cell.chain)


def tcp_target(cell: Cell, chain: ElasticChain) -> Float:
    """``T_tcp_target`` of the tracker table, whichever frame it names."""
    table = cell.tables.tracker
    if table is None:
        raise InputError("the cell has no tracker", where=str(cell.path))
    if table.target_on == "tcp":
        return table.T_on_target
    T_flange_target = table.T_on_target
    out: Float = pose.inverse(chain.T_flange_tcp) @ T_flange_target
    return out
