"""Correct while milling: the loop of a cell built from its files, run beside a recorder in another process."""

from __future__ import annotations

import contextlib
import hashlib
import multiprocessing
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from counterflex import __version__
from counterflex.app.compliance_window import require_plausible
from counterflex.app.job_check import check_job
from counterflex.app.made_on import made_on
from counterflex.app.process_events import shown_process
from counterflex.app.robot_links import egm_link, rsi_link
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import CounterflexError, FileFormatError, InputError, OutputError
from counterflex.core.units import MS
from counterflex.evaluate.latency import LatencyHistogram
from counterflex.evaluate.process_record import ProcessEvent, ProcessRecord
from counterflex.files.cell import Cell, read_cell
from counterflex.files.cell_monitor import feed_exponent
from counterflex.files.cell_online import OnlineTable
from counterflex.files.cell_sensing import flange_sensor
from counterflex.files.machine_file import machine_file
from counterflex.files.plan_file import read_plan
from counterflex.files.run_log import RunLog
from counterflex.files.summary_file import write_summary
from counterflex.geometry import pose
from counterflex.links.egm_force import EgmForce
from counterflex.links.egm_link import EgmLink
from counterflex.links.force_source import ForceSource
from counterflex.links.instance_lock import InstanceLock
from counterflex.links.netft_link import NetftLink, fetch_scaling
from counterflex.links.realtime import prepare
from counterflex.links.robot_link import RobotLink
from counterflex.links.session import CONTROL, OnlineSession, Request, SessionChecks, Tally, tracker_frames
from counterflex.links.telegram_watch import WatchSettings
from counterflex.links.tracker_link import TrackerLink
from counterflex.plan.ahead import ahead_wrench, arm_share
from counterflex.plan.plan import Plan, across
from counterflex.robot.chain import ElasticChain
from counterflex.runtime.fusion import Source
from counterflex.runtime.layout import O_CAUSE, O_DEGRADED, O_SOFT, O_SOURCES, O_STATE
from counterflex.runtime.loop import Loop
from counterflex.runtime.loop_plan import LoopPlan
from counterflex.runtime.monitor_layout import R_SPEED
from counterflex.runtime.monitor_settings import unwatched
from counterflex.runtime.record_ring import MONITOR, OUTCOME, RESULTS, RecordRing
from counterflex.runtime.sensor_wrench import SensorWrench
from counterflex.runtime.spindle_inertia import SpindleInertia
from counterflex.runtime.supervisor import Cause, State
from counterflex.signals.preview import Mode, Shaping
from counterflex.wire.netft import Scaling

SUMMARY = "summary.json"
AS_ASKED = "as asked"
"""How a loop ended that ended by itself."""
_QUIET_S = 2.0
_EXPONENT = 0.75
"""Of the force in the feed, where there is no plan to take it from."""
_POLL_S = 0.02
_SLICE_S = 0.1
"""How long a loop in lockstep waits before it looks whether it is to end."""
_END_S = 5.0
"""How long ramping out may take before the loop ends all the same."""
_ACTING = (State.ACTIVE, State.HOLD, State.RAMP_OUT)


def loop_plan(plan: Plan, cell: Cell, *, compensated: bool) -> LoopPlan:
    """What the loop needs of a plan.

    Args:
        plan: Of the program.
        cell: Its arm, its lowest mode and its delays say what has to be commanded ahead of time.
        compensated: The robot runs the compensated program, so that its points contain the plan's correction.
    """
    contained = np.concatenate([plan.correction_part, plan.rotvec_part], axis=1)
    if not compensated:
        contained = np.zeros_like(contained)
    dynamics = cell.tables.dynamics
    delays = (cell.tables.online or OnlineTable()).settings(cell.tables.timing, compensated=compensated).delays
    modes = (
        Mode(2.0 * np.pi * dynamics.mode_hz, dynamics.damping_ratio),
        Mode(delays.natural_per_s, delays.damping),
    )
    shaping = Shaping(dynamics.correction_smoothing_ms * MS, delays.dead_s + dynamics.correction_lead_ms * MS)
    share = arm_share(cell.chain, cell.T_base_part, plan.q, plan.w_tcp_part)
    return LoopPlan(
        p_part=plan.path.p_part_tcp + contained[:, :3],
        time_s=plan.path.time_s,
        w_tcp_part=plan.w_tcp_part,
        cutting=plan.cutting.astype(np.float64),
        contained=contained,
        play=plan.play_part,
        turn_per_s=np.abs(plan.path.spindle_rad_s) / (2.0 * np.pi),
        tool=plan.path.tool.astype(np.int64),
        chip_m=plan.feed_per_tooth_m * np.sin(0.5 * (plan.entry_rad + plan.exit_rad)),
        need_m=None if compensated else across(-plan.deflection_part[:, :3], plan.path.p_part_tcp),
        left_m=np.linalg.norm(across(plan.deviation_compensated_part, plan.path.p_part_tcp), axis=1)
        if compensated
        else None,
        w_ahead_part=ahead_wrench(plan.w_tcp_part, plan.path.time_s, share, modes, shaping),
    )


@dataclass(frozen=True)
class RunSettings:
    """What a run is made of.

    Attributes:
        cell: Cell file with an ``[online]`` table.
        rsi: ETHERNET configuration file of a KUKA controller, or None.
        plan: Plan file, or None.
        program: What the robot runs, or None; it must be of the same job as the plan.
        compensated: The robot runs the compensated program.
        host: Address to listen on.
        port: Of the robot; None takes the configuration's, or that of the table ``[egm]``.
        egm: The robot is an ABB one, as the table ``[egm]`` says.
        force: Host and UDP port of the force sensor, or None; with EGM the robot's own force is then taken.
        force_http_port: Of its scaling document.
        force_wait_s: How long to wait for the sensor to serve it: parts of a cell may be started in any order.
        tracker_port: Port for tracker datagrams, or None.
        peer: Address and port of the controller, port 0 for any; None takes the first that sends a good telegram.
        arm: Arm as soon as all checks are passed; else only watch.
        lockstep: The robot is simulated and waits for every answer: telegrams are lost by their counter only.
        quiet_s: End when no telegram has come for so long, after the first.
    """

    cell: Path
    rsi: Path | None = None
    plan: Path | None = None
    compensated: bool = True
    host: str = "127.0.0.1"
    port: int | None = None
    egm: bool = False
    force: tuple[str, int] | None = None
    force_http_port: int = 80
    force_wait_s: float = 10.0
    tracker_port: int | None = None
    peer: tuple[str, int] | None = None
    arm: bool = False
    lockstep: bool = False
    quiet_s: float = _QUIET_S
    program: Path | None = None


def online_loop(cell: Cell, plan: LoopPlan | None, *, compensated: bool) -> Loop:
    """The loop of a cell.

    Raises:
        FileFormatError: The cell has no ``[online]`` table.
        InputError: Its values contradict each other, or need a plan.
    """
    table = cell.tables.online
    if table is None:
        raise FileFormatError(
            "the cell file does not say how to correct online",
            where=str(cell.path),
            hint='Add a table [online], for example with force = "pilot"',
        )
    settings = table.settings(cell.tables.timing, compensated=compensated, mode=cell.tables.lowest_mode)
    watched, override = cell.tables.monitor, cell.tables.override
    teeth = None
    exponent = _EXPONENT
    if plan is not None and plan.tool is not None:
        flutes = {tool.number: tool.flutes for tool in cell.tables.tools}
        teeth = np.array([flutes.get(int(number), 0) for number in plan.tool], dtype=np.int64)
        if plan.chip_m is not None and np.any(chips := np.isfinite(plan.chip_m) & (plan.chip_m > 0.0)):
            exponent = feed_exponent(cell.force_law, float(np.median(plan.chip_m[chips])))
        plan = replace(plan, teeth=teeth)
    return Loop(
        cell.chain,
        settings,
        cell.T_base_part,
        plan,
        monitor=unwatched(settings, exponent) if watched is None else watched.settings(settings, exponent),
        override=None if override is None else override.settings(),
    )


def one_protocol(settings: RunSettings) -> None:
    """Check that the robot's protocol is chosen.

    Raises:
        InputError: None or both are.
    """
    if (settings.rsi is None) == (not settings.egm):
        raise InputError(
            "the robot's protocol is not clear",
            value="both" if settings.egm else "none",
            limit="one of RSI and EGM",
            hint="Give --rsi FILE for a KUKA robot, --egm for an ABB one",
        )


def open_session(settings: RunSettings, *, ring: RecordRing | None = None, control: Int | None = None) -> OnlineSession:
    """Read the files, build the loop and open the links.

    Raises:
        FileFormatError: A file cannot be used.
        InputError: What the cell wants to use is not given.
        OutputError: A port or the sensor cannot be reached.
    """
    cell = read_cell(settings.cell)
    require_plausible(cell)
    one_protocol(settings)
    read = None if settings.plan is None else read_plan(settings.plan)
    if settings.program is not None:
        check_job(settings.program, read, compensated=settings.compensated)
    planned = None if read is None else read[0]
    plan = None if planned is None else loop_plan(planned, cell, compensated=settings.compensated)
    loop = online_loop(cell, plan, compensated=settings.compensated and plan is not None)
    table = cell.tables.online or OnlineTable()
    sensor = flange_sensor(cell.tables.sensor, cell.chain)
    fused = table.force == "fused"
    if fused and settings.force is None and settings.tracker_port is None and plan is None:
        raise InputError(
            "the estimator has nothing to estimate from",
            where=str(settings.cell),
            value='force = "fused"',
            hint="Give --force HOST:PORT, --tracker PORT, --plan FILE, or several of them",
        )
    without = (settings.force is None and not settings.egm) or sensor is None
    if table.force != "none" and without and not (fused and settings.force is None):
        raise InputError(
            "the force is to be corrected from, but there is no force sensor",
            where=str(settings.cell),
            value=f'force = "{table.force}"',
            hint='Give --force HOST:PORT and a table [sensor], or set force = "none"',
        )
    wanted = table.tracker != "none" or (fused and settings.tracker_port is not None)
    if wanted and (settings.tracker_port is None or cell.tables.tracker is None):
        raise InputError(
            "the tracker is to be corrected from, but there is none",
            where=str(settings.cell),
            value=f'tracker = "{table.tracker}"',
            hint='Give --tracker PORT and a table [tracker], or set tracker = "none"',
        )
    link = _link(settings, cell, loop, planned)
    force: ForceSource | None = None
    tracker = wrench = None
    frames: tuple[Float | None, Float | None] = (None, None)
    if settings.force is not None and sensor is not None:
        measured = cell.tables.sensor
        ranges = (None, None) if measured is None else (measured.range_n, measured.range_nm)
        netft = NetftLink(settings.force, _scaling(settings), range_n=ranges[0], range_nm=ranges[1])
        netft.start()
        force, wrench = netft, SensorWrench(cell.chain, sensor, cell.T_base_part)
    elif isinstance(link, EgmLink) and sensor is not None and table.force != "none":
        force, wrench = EgmForce(link), SensorWrench(cell.chain, sensor, cell.T_base_part)
    inertia = None
    if sensor is not None and loop.settings.inertia_hz > 0.0:
        hz, period = loop.settings.inertia_hz, loop.settings.period_s
        inertia = SpindleInertia(cell.chain, sensor, cell.T_base_part, hz, period)
    if settings.tracker_port is not None and cell.tables.tracker is not None:
        tracker = TrackerLink(settings.host, settings.tracker_port)
        frames = tracker_frames(cell.T_base_part, cell.tables.tracker.T_base_tracker, tcp_target(cell, cell.chain))
    return OnlineSession(
        link,
        loop,
        force=force,
        wrench=wrench,
        inertia=inertia,
        tracker=tracker,
        T_part_tracker=frames[0],
        T_target_tcp=frames[1],
        ring=ring,
        control=control,
        checks=SessionChecks(),
        watch=WatchSettings(clock=not settings.lockstep),
    )


def _link(settings: RunSettings, cell: Cell, loop: Loop, plan: Plan | None) -> RobotLink:
    if settings.rsi is not None:
        return rsi_link(
            settings.rsi,
            loop.settings,
            settings.host,
            settings.port,
            settings.peer,
            overriding=loop.monitor.overriding,
        )
    return egm_link(
        cell,
        loop.settings,
        plan,
        compensated=settings.compensated,
        watch_only=not settings.arm,
        host=settings.host,
        port=settings.port,
        peer=settings.peer,
    )


def _scaling(settings: RunSettings) -> Scaling:
    host = settings.force[0] if settings.force is not None else ""
    end = time.monotonic() + settings.force_wait_s
    while True:
        try:
            return fetch_scaling(host, settings.force_http_port)
        except OutputError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)


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


@dataclass(frozen=True)
class Status:
    """What a run looks like from outside, now and then.

    Attributes:
        state: Of the supervisor.
        cause: Why.
        cycles: Answered.
        correction_um: (3,) of the tool, part axes.
        compute_us: Median time of a cycle since the last status.
        log_trouble: Why the log cannot be written, or empty.
        foreign: Telegrams from an address that is not the controller's, so far.
        sources: What the estimate rests on; nothing without an estimator.
        degraded: Why one of its sources is missing.
        events: Of the process, since the last status.
        speed: Share of the programmed speed that is asked for.
    """

    state: State
    cause: Cause
    cycles: int
    correction_um: tuple[float, float, float]
    compute_us: float
    log_trouble: str
    foreign: int = 0
    sources: Source = Source.NOTHING
    degraded: Cause = Cause.NONE
    events: tuple[ProcessEvent, ...] = ()
    speed: float = 1.0


def run(
    settings: RunSettings,
    out: str | Path,
    *,
    watch: Callable[[Status], None] = lambda _: None,
    most_s: float | None = None,
    started: Callable[[tuple[str, int]], None] = lambda _: None,
    ended: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """Run the loop in a process of its own and record it from this one.

    Args:
        settings: See :class:`RunSettings`.
        out: Folder of the run log.
        watch: Told the status twice a second.
        most_s: End after so long; None goes on until the telegrams stop.
        started: Told the address at which telegrams are expected, once.
        ended: Whether the robot is known to be gone; asked now and then.

    Returns:
        Summary: cycles, times, states, losses, what process monitoring found; also written as ``summary.json``.

    Raises:
        CounterflexError: As :func:`open_session`, and when the log cannot be begun.
    """
    one_protocol(settings)
    context = multiprocessing.get_context("spawn")
    control = context.Array("q", CONTROL, lock=False)
    parent, child = context.Pipe()
    ring = RecordRing()
    log: RunLog | None = None
    process: BaseProcess | None = None
    try:
        process = context.Process(target=loop_process, args=(settings, ring.name, control, child), daemon=True)
        process.start()
        child.close()
        try:
            said = parent.recv()
        except EOFError:
            raise OutputError("the loop's process died before it began", value=process.exitcode) from None
        if isinstance(said, BaseException):
            raise said
        where, loop_sha256 = said
        log = RunLog(out, _about(settings, loop_sha256))
        started(where)
        summary = _record(ring, log, process, control, watch, most_s, ended, arm=settings.arm)
        with contextlib.suppress(EOFError):
            if parent.poll():
                raise parent.recv()
        write_summary(Path(out) / SUMMARY, {"job": "run", "cell": settings.cell.name, **summary})
        return summary
    finally:
        control[Request.END] = 1
        if log is not None:
            log.close()
        if process is not None:
            process.join(_END_S)
        ring.close()


def _record(
    ring: RecordRing,
    log: RunLog,
    process: BaseProcess,
    control: Any,
    watch: Callable[[Status], None],
    most_s: float | None,
    ended: Callable[[], bool],
    *,
    arm: bool,
) -> dict[str, Any]:
    reader = RecordRing(ring.name)
    reader.rewind()
    begin = time.monotonic()
    shown = begin
    times = LatencyHistogram()
    states: dict[str, int] = {}
    cycles, worst, faults = 0, 0.0, set()
    recent: list[Float] = []
    seen = ProcessRecord()
    events: list[ProcessEvent] = []
    try:
        while True:
            alive = process.is_alive()
            rows = reader.take()
            if len(rows):
                log.add(rows)
                compute = (rows[:, 2] - rows[:, 1]) * 1e-3
                times.add(compute[rows[:, 3] > 0])
                recent.append(rows)
                events += seen.add(rows)
                cycles += int(np.sum(rows[:, 3] > 0))
                worst = max(worst, float(np.max(np.linalg.norm(rows[:, RESULTS : RESULTS + 3], axis=1))))
                for value, count in zip(*np.unique(rows[:, OUTCOME + O_STATE], return_counts=True), strict=True):
                    name = State(int(value)).name.lower()
                    states[name] = states.get(name, 0) + int(count)
                for column in (O_CAUSE, O_SOFT, O_DEGRADED):
                    faults |= {Cause(int(c)).name.lower() for c in np.unique(rows[:, OUTCOME + column]) if c}
            now = time.monotonic()
            if now - shown > 0.5 and recent:
                last = recent[-1][-1]
                tail = np.concatenate([(r[:, 2] - r[:, 1]) * 1e-3 for r in recent])
                watch(
                    Status(
                        State(int(last[OUTCOME + O_STATE])),
                        Cause(int(last[OUTCOME + O_CAUSE]) or int(last[OUTCOME + O_SOFT])),
                        cycles,
                        tuple(float(v) * 1e6 for v in last[RESULTS : RESULTS + 3]),  # type: ignore[arg-type]
                        float(np.median(tail)),
                        log.trouble,
                        int(control[Tally.FOREIGN]),
                        Source(int(last[OUTCOME + O_SOURCES])),
                        Cause(int(last[OUTCOME + O_DEGRADED])),
                        tuple(events),
                        float(last[MONITOR + R_SPEED]),
                    )
                )
                shown, recent, events = now, [], []
            if not alive:
                break
            if (most_s is not None and now - begin > most_s) or ended():
                control[Request.END] = 1
            if log.trouble:
                control[Request.ARM] = 0  # what is not recorded is not corrected
            elif arm:
                arm = not np.any(rows[:, OUTCOME + O_STATE] >= State.ARMED)
                control[Request.ARM] = int(arm)
            try:
                time.sleep(_POLL_S)
            except KeyboardInterrupt:
                if control[Request.END]:
                    raise
                control[Request.END] = 1  # the loop ramps out first; a second time it is left alone
        rows = reader.take()
        seen.add(rows)
        log.add(rows)
    finally:
        reader.close()
    return {
        "cycles": cycles,
        "seconds": round(time.monotonic() - begin, 2),
        "states": states,
        "causes": sorted(faults),
        **shown_process(seen.figures()),
        "largest_correction_um": round(worst * 1e6, 1),
        "compute_us": {
            "p50": round(times.at(0.5), 1),
            "p99": round(times.at(0.99), 1),
            "p99.9": round(times.at(0.999), 1),
            "max": round(times.largest, 1),
        },
        "telegrams": {tally.name.lower(): int(control[tally]) for tally in Tally},
        "loop_ended": AS_ASKED if process.exitcode == 0 else f"died ({process.exitcode})",
        "records": log.written,
        "records_lost": log.lost + reader.dropped,
        "counterflex": __version__,
    }


def _about(settings: RunSettings, loop_sha256: str) -> dict[str, Any]:
    files = {"cell": settings.cell, "rsi": settings.rsi, "plan": settings.plan, "program": settings.program}
    hashes = {
        name: hashlib.sha256(Path(p).read_bytes()).hexdigest() for name, p in files.items() if p and Path(p).is_file()
    }
    return {
        "counterflex": __version__,
        "files": {name: str(p) for name, p in files.items() if p},
        "sha256": hashes,
        "loop_sha256": loop_sha256,
        "machine": made_on(),
        "compensated": settings.compensated,
        "wall_minus_monotonic_ns": time.time_ns() - time.monotonic_ns(),
    }


def loop_process(settings: RunSettings, ring_name: str, control: Any, pipe: Any) -> None:
    """The loop's own process: builds the session, says where it listens, cycles until it is asked to end.

    An interrupt from the keyboard is left to the recorder, which asks the loop to end.

    Args:
        settings: See :class:`RunSettings`.
        ring_name: Of the ring of records.
        control: Shared array of :data:`counterflex.links.session.CONTROL` numbers.
        pipe: Told the address and the loop's hash, or what went wrong.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        ring = RecordRing(ring_name)
        shared: Int = np.frombuffer(control, dtype=np.int64)
        session = open_session(settings, ring=ring, control=shared)
        lock = InstanceLock(machine_file().parent, session.link.address[1])
        session.loop.run()
        session.loop.reset()
        prepare()
    except BaseException as fault:
        pipe.send(fault)
        return
    pipe.send((session.link.address, session.loop.sha256()))
    try:
        _cycle_on(session, settings, shared)
    except CounterflexError as fault:
        pipe.send(fault)
    session.link.close()
    if session.force is not None:
        session.force.close()
    lock.close()
    ring.close()


def _cycle_on(session: OnlineSession, settings: RunSettings, control: Int) -> None:
    """Cycle until asked to end, or until the telegrams stop. A correction that is there is ramped out first."""
    quiet = 0.0
    end_ns = 0
    while True:
        if control[Request.END]:
            end_ns = end_ns or time.monotonic_ns() + round(_END_S * 1e9)
            control[Request.STOP] = 1
            if session.loop.state not in _ACTING or time.monotonic_ns() > end_ns:
                return
        if session.cycles == 0:
            session.cycle(0.1)
            continue
        if settings.lockstep:  # a robot that waits is never late: no cycle without a telegram
            came, waited = session.link.wait(_SLICE_S), _SLICE_S
            if came:
                session.deal(True)
        else:
            waited = session.patience_s
            came = session.cycle(waited)
        quiet = 0.0 if came else quiet + waited
        if quiet >= settings.quiet_s or (settings.lockstep and not came and control[Request.END]):
            return
