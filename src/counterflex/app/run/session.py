"""Parts of a run: the files read, the loop built, the links opened."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from counterflex.app.compliance_window import require_plausible
from counterflex.app.run.holder import open_holder, tools_of
from counterflex.app.run.job_check import cell_of_run, check_job, job_of
from counterflex.app.run.loop import load_behind, loop_plan, online_loop, tcp_target
from counterflex.app.run.pair import open_pair
from counterflex.app.run.robot_links import ROBOT_LINKS, Chosen, LinkOrder, RobotLinkKind, chosen, values_of
from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import US
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.online import OnlineTable
from counterflex.files.cell.sensing import SensorTable, flange_sensor
from counterflex.files.plan_file import TOOL_TURNS, WORKING_PLANE, read_plan
from counterflex.plan.plan import Plan
from counterflex.protocols.force.sensors import Opening, link_values, opened
from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.session.senses import ProcessWrench, Sensing, tracker_frames
from counterflex.protocols.session.session import OnlineSession, SessionChecks, compile_kernels
from counterflex.protocols.session.tare import Tare
from counterflex.protocols.session.telegram_watch import WatchSettings
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.runtime.loop import Loop
from counterflex.runtime.plausibility.axis_check import ABSENT, AxisCheck
from counterflex.runtime.record_ring import RecordRing
from counterflex.runtime.sensing.motor_torque import MotorTorque
from counterflex.runtime.sensing.sensor_wrench import SensorWrench
from counterflex.runtime.sensing.spindle_inertia import SpindleInertia

QUIET_S = 2.0
"""Without a telegram for so long, a run has ended."""
_MEAN_OF = 8  # Most poses of a tracker in a cycle of which the mean is taken; more have piled up


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run.

    Attributes:
        cell: Cell file with an ``[online]`` table.
        robot: Name of the link to the robot and the file that it is set up by, or None: the one that the cell names.
        plan: Plan file, or None.
        program: What the robot runs, or None; it must be of the same job as the plan.
        compensated: The robot runs the compensated program.
        host: Address to listen on.
        port: Of the robot; None takes the one of the file or of the cell.
        force: Host and UDP port of the force sensor, or None; the robot's own force is then taken, if it sends one.
        currents: The motor currents that the robot sends are used by the estimator.
        strain_port: Port for strain datagrams of the instrumented holder, or None.
        force_wait_s: How long to wait for the sensor to serve it: parts of a cell may be started in any order.
        tracker_port: Port for tracker datagrams, or None.
        peer: Address and port of the controller, port 0 for any; None takes the first that sends a good telegram.
        arm: Arm as soon as all checks are passed; else only watch.
        lockstep: The robot is simulated and waits for every answer: telegrams are lost by their counter only.
        quiet_s: End when no telegram has come for so long, after the first.
    """

    cell: Path
    robot: Chosen | None = None
    plan: Path | None = None
    compensated: bool = True
    host: str = "127.0.0.1"
    port: int | None = None
    force: tuple[str, int] | None = None
    force_http_port: int = 80
    currents: bool = False
    strain_port: int | None = None
    force_wait_s: float = 10.0
    tracker_port: int | None = None
    peer: tuple[str, int] | None = None
    arm: bool = False
    lockstep: bool = False
    quiet_s: float = QUIET_S
    program: Path | None = None

    @property
    def kind(self) -> RobotLinkKind:
        """Kind of the robot's link."""
        return ROBOT_LINKS[(self.robot or ("",))[0]]

    @property
    def robot_files(self) -> dict[str, Path]:
        """The file that the robot's link is set up by, by the name of the link; empty where it has none."""
        name, file = self.robot or ("", None)
        return {} if file is None else {name: file}


def one_protocol(settings: RunSettings) -> RunSettings:
    """Return the settings with the robot's link, its file read once before anything is compiled.

    Raises:
        InputError: It is not clear.
        FileFormatError: The file is not one of this link.
    """
    name, file = chosen(None, read_cell(settings.cell)) if settings.robot is None else settings.robot
    read = ROBOT_LINKS[name].read
    if read is not None and file is not None:
        read(file)
    return replace(settings, robot=(name, file))


def _require_upright(about: Mapping[str, Any], plan: Path | None) -> None:
    """Refuse plans whose corrections are not those of a tool along z of the part."""
    for key, what in (
        (
            WORKING_PLANE,
            "a plan for a tilted tool cannot be run with online correction: it is given in its working plane",
        ),
        (TOOL_TURNS, "a plan whose tool turns while it cuts cannot be run with online correction"),
    ):
        if key in about:
            raise InputError(what, where=str(plan), hint="Run the compensated program without the loop")


def _read(settings: RunSettings) -> tuple[tuple[Plan, dict[str, Any]] | None, Cell, RunSettings]:
    """Plan and what it says of itself, cell, and settings with the robot that the cell chooses, checked together."""
    read = None if settings.plan is None else read_plan(settings.plan)
    cell = cell_of_run(settings.cell, read, settings.plan)
    require_plausible(cell)
    if read is not None:
        _require_upright(read[1], settings.plan)
    settings = one_protocol(replace(settings, robot=chosen(settings.robot, cell)))
    if settings.program is not None:
        check_job(settings.program, read, compensated=settings.compensated)
    if read is not None and not settings.compensated:
        _require_programmed_feed(read[1], settings.plan)
        _require_no_measured(read[0], settings.plan)
    return read, cell, settings


def _measured_at(settings: RunSettings, table: OnlineTable, *, planned: bool) -> bool:
    """Return whether what the cell takes its force from has an address.

    Raises:
        InputError: An estimator has nothing to estimate from.
    """
    _one_force(settings, table)
    ports = [settings.force, settings.strain_port]
    if table.force_from == "both":
        measured = None not in ports
    else:
        measured = ports[table.force_from == "holder" and table.force != "none"] is not None
    if table.force == "fused" and not (measured or planned or settings.tracker_port is not None):
        raise InputError(
            "the estimator has nothing to estimate from", where=str(settings.cell), value='force = "fused"',
            hint="Give force_sensor.address or tracker.address (--scenario), --plan FILE, or several of them",
        )  # fmt: skip
    return measured


def _require_force(settings: RunSettings, table: OnlineTable, *, measured: bool, known: bool) -> None:
    """Refuse a run without what it takes its force from; ``known``: how the sensor sits in the robot."""
    if table.force == "none" or (table.force == "fused" and not measured):
        return
    unreached = not measured and (table.force_from != "sensor" or settings.kind.own_force is None)
    if unreached or not known:
        source = f', force_from = "{table.force_from}"' if table.force_from != "sensor" else ""
        raise _no_sensor(settings, f'force = "{table.force}"{source}', unreached=unreached, unknown=not known)


def _require_tracker(settings: RunSettings, cell: Cell, table: OnlineTable) -> None:
    """Refuse a run that takes its place from a tracker and has none."""
    if table.tracker == "none" and (table.force != "fused" or settings.tracker_port is None):
        return
    lacking = ["tracker.address (--scenario)"] if settings.tracker_port is None else []
    lacking += ["a table [tracker] (counterflex identify tracker-frame)"] if cell.tables.tracker is None else []
    if lacking:
        raise InputError(
            "[online] tracker needs a tracker, and none is given", where=str(settings.cell),
            value=f'tracker = "{table.tracker}"', limit=" and ".join(lacking),
            hint='Or set tracker = "none" in [online]',
        )  # fmt: skip


def open_session(settings: RunSettings, *, ring: RecordRing | None = None, control: Int | None = None) -> OnlineSession:
    """Read the files, build the loop and open the links.

    Raises:
        FileFormatError: A file cannot be used.
        InputError: What the cell wants to use is not given.
        OutputError: A port or the sensor cannot be reached.
    """
    read, cell, settings = _read(settings)
    planned = None if read is None else read[0]
    plan = None if planned is None else loop_plan(planned, cell, compensated=settings.compensated)
    loop = online_loop(cell, plan, compensated=settings.compensated and plan is not None)
    table = cell.tables.online or OnlineTable()
    sensor = load_behind(cell)
    measured = _measured_at(settings, table, planned=plan is not None)
    motors = _motors(settings, cell, table, plan is not None)
    _require_force(settings, table, measured=measured, known=sensor is not None)
    _require_tracker(settings, cell, table)
    compile_kernels()  # before a port is open: what arrives meanwhile would be old
    link = _link(settings, cell, loop, planned)
    checks = SessionChecks(
        hold_without_log=table.without_log == "hold",
        hold_without_panel=table.without_panel == "hold",
        job=job_of(read, compensated=settings.compensated),
        run_silent_s=None if settings.lockstep else SessionChecks.run_silent_s,
    )
    tracker = None
    frames: tuple[Float | None, Float | None] = (None, None)
    force, wrench, tare = _open_force(settings, cell, table, link, planned, checks)
    inertia = None
    if sensor is not None and loop.settings.inertia_hz > 0.0:
        hz, period = loop.settings.inertia_hz, loop.settings.period_s
        inertia = SpindleInertia(cell.chain, sensor, cell.T_base_part, hz, period)
    if settings.tracker_port is not None and cell.tables.tracker is not None:
        most = _MEAN_OF if table.tracker == "designed" else 1  # as published, the newest pose counts
        tracker = TrackerLink(settings.host, settings.tracker_port, mean_of=most)
        frames = tracker_frames(cell.T_base_part, cell.tables.tracker.T_base_tracker, tcp_target(cell, cell.chain))
    return OnlineSession(
        link,
        loop,
        sensing=Sensing(
            force=force,
            wrench=wrench,
            tare=tare,
            tools=tools_of(planned, cell, sensor, wrench),
            inertia=inertia,
            currents=motors,
            angles=_axis_check(cell, table, loop),
            tracker=tracker,
            T_part_tracker=frames[0],
            T_target_tcp=frames[1],
        ),
        ring=ring,
        control=control,
        checks=checks,
        watch=WatchSettings(clock=not settings.lockstep, malformed_hold=1 if settings.lockstep else 3),
    )


def _require_reported(settings: RunSettings, loop: Loop, link: RobotLink) -> None:
    """Refuse controllers of the axes where the robot controller does not say what is in effect."""
    if loop.settings.axis_pid is not None and link.measured_is == ABSENT:
        link.close()
        raise InputError(
            "a PID per axis needs the measured pose, and the controller sends none",
            where=str(settings.cell),
            hint="Leave out the table [online.axis_pid]",
        )


def _axis_check(cell: Cell, table: OnlineTable, loop: Loop) -> AxisCheck | None:
    """Axis angles against poses: by the geometry that the controller computes with."""
    tolerance = table.axis_tolerance
    if tolerance is None:
        return None
    T_base_part = np.eye(4) if cell.holds_part else cell.T_base_part
    return AxisCheck(cell.controller_chain, T_base_part, loop.settings.period_s, tolerance, cell.T_base_tcp)


def _require_programmed_feed(about: Mapping[str, Any], plan: Path | None) -> None:
    """Refuse a plan at lowered feeds for a robot that runs the original program: its force and times are others."""
    lowered_s = float(about.get("feed_lowered_s", 0.0))
    if lowered_s > 0.0:
        raise InputError(
            "the plan is for a lower feed than the original program runs", where=str(plan),
            value=f"{lowered_s:g} s longer", limit="the programmed feed",
            hint="Plan with compensate --programmed-feed, or run the compensated program",
        )  # fmt: skip


def _require_no_measured(plan: Plan, file: Path | None) -> None:
    """Refuse a plan corrected from measured parts for a robot that runs the original program, which has none of it."""
    if plan.measured_part is not None:
        raise InputError(
            "the plan takes back what was measured on parts, and the original program has none of it",
            where=str(file),
            hint="Run the corrected program, or plan with compensate for --original",
        )


def _motors(settings: RunSettings, cell: Cell, table: OnlineTable, planned: bool) -> MotorTorque | None:
    """Return the converter of motor currents to torques, where they are to be used."""
    if not settings.currents:
        return None
    constants = table.torque_per_current_nm
    lacking, hint = "", ""
    if table.force != "fused":
        lacking, hint = f'force = "{table.force}" does not take them', 'Set force = "fused", or leave out run.currents'
    elif constants is None:
        lacking, hint = "the torque of a motor by its current is not known", "Give torque_per_current_nm in [online]"
    elif not planned:
        lacking, hint = "motor currents are compared with the planned force, and no plan is given", "Give --plan FILE"
    if lacking or constants is None:
        raise InputError(
            f"the motor currents are to be used, but {lacking}", where=str(settings.cell), value="run.currents",
            hint=hint,
        )  # fmt: skip
    return MotorTorque(cell.chain, np.array(constants))


def _open_force(
    settings: RunSettings, cell: Cell, table: OnlineTable, link: RobotLink, plan: Plan | None, checks: SessionChecks
) -> tuple[ForceSource | None, ProcessWrench | None, Tare | None]:
    """Open the source of the force; with it, the process wrench made of it and its tare where that is special."""
    if table.force_from == "holder":
        if table.force == "none" or settings.strain_port is None:
            return None, None, None
        return open_holder(cell, plan, settings.host, settings.strain_port, checks.force_n, checks.moment_nm)
    measured, sensor = cell.tables.sensor, flange_sensor(cell.tables.sensor, cell.chain)
    if measured is None or sensor is None:
        return None, None, None
    if settings.force is not None:
        force = opened(measured.protocol, _opening(settings, settings.force, measured))
        wrench = SensorWrench(cell.chain, sensor, None if cell.holds_part else cell.T_base_part)
        if table.force_from == "both" and settings.strain_port is not None:
            strains = settings.host, settings.strain_port
            return open_pair(cell, table, plan, (force, wrench), strains, checks.force_n, checks.moment_nm)
        return force, wrench, None
    own = settings.kind.own_force
    if own is not None and table.force != "none":
        return own(link, measured.range_n, measured.range_nm), SensorWrench(cell.chain, sensor, cell.T_base_part), None
    return None, None, None


def _one_force(settings: RunSettings, table: OnlineTable) -> None:
    """Refuse an address of the force that the cell file does not use.

    Raises:
        InputError: Strains for a cell that takes its force from a flange sensor, or the other way round.
    """
    if table.force_from == "both":
        return
    held = table.force_from == "holder"
    unused = settings.strain_port if not held else settings.force
    if unused is not None:
        raise InputError(
            "[online] takes its force from elsewhere",
            where=str(settings.cell),
            value=f'force_from = "{table.force_from}", and {"force_sensor" if held else "strain"}.address is given',
            hint=f'Leave it out, or set force_from = "{"sensor" if held else "holder"}"',
        )


def _no_sensor(settings: RunSettings, value: str, *, unreached: bool, unknown: bool) -> InputError:
    """Error of a force sensor of which something is lacking: where it is, or how it sits in the robot."""
    address = "strain.address" if "holder" in value else "force_sensor.address"
    if '"both"' in value:
        address = "force_sensor.address or strain.address"
    lacking = [f"{address} (--scenario)"] if unreached else []
    lacking += ["a table [sensor], which counterflex identify payload finds,"] if unknown else []
    return InputError(
        "[online] force needs a force sensor, and none is given",
        where=str(settings.cell),
        value=value,
        limit=" and ".join(lacking).rstrip(","),
        hint='Or set force = "none" in [online]',
    )


def _link(settings: RunSettings, cell: Cell, loop: Loop, plan: Plan | None) -> RobotLink:
    name, file = settings.robot or ("", None)
    link = ROBOT_LINKS[name].open(
        LinkOrder(
            cell=cell,
            file=file,
            online=loop.settings,
            host=settings.host,
            port=settings.port,
            peer=settings.peer,
            plan=plan,
            compensated=settings.compensated,
            watch_only=not settings.arm,
            overriding=loop.monitor.overriding,
            currents=settings.currents,
            values=values_of(name, cell),
        )
    )
    _require_reported(settings, loop, link)
    if hasattr(link, "poll"):  # a link of another package may leave it out
        link.poll(loop.settings.period_s, (cell.tables.online or OnlineTable()).spin_us * US)
    return link


def _opening(settings: RunSettings, address: tuple[str, int], table: SensorTable) -> Opening:
    """Address of the force sensor with the settings of its link in the cell file."""
    return Opening(
        *address,
        http_port=settings.force_http_port,
        wait_s=settings.force_wait_s,
        range_n=table.range_n,
        range_nm=table.range_nm,
        values=link_values(table.protocol, table.link),
        frame=None if table.frame is None else table.frame.source(),
    )
