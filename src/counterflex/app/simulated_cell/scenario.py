"""Tables of a scenario as what the simulated controllers and instruments take, in SI."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, MM_PER_MIN, MS
from counterflex.files.fault_file import short_fault
from counterflex.files.logs.wrench_log import read_wrench_log
from counterflex.files.scenario_file import (
    ForceSensorTable,
    NetworkTable,
    Scenario,
    ScenarioControllerTable,
    ScenarioTrackerTable,
    TargetTable,
)
from counterflex.geometry import pose
from counterflex.twin.devices.path_answer import PathAnswer
from counterflex.twin.devices.pose_source import CircleTarget, PoseSource, SquareTarget, StandingTarget
from counterflex.twin.devices.robot_server import Timing
from counterflex.twin.devices.wrench_source import NoisyWrench, RecordedWrench, SteadyWrench, WrenchSource
from counterflex.twin.network.faults import Fault, FaultSchedule
from counterflex.twin.network.impairment import Burst, Impairment, Stall


def schedule(scenario: Scenario, short: Iterable[str] | None = None, more: tuple[Fault, ...] = ()) -> FaultSchedule:
    """Faults of a scenario, those of ``--fault`` and more. Raises InputError: a fault cannot be used."""
    tables = (*scenario.faults, *map(short_fault, short or ()))
    return FaultSchedule((*more, *(table.fault() for table in tables)), scenario.seed)


def late(table: ScenarioTrackerTable) -> tuple[Fault, ...]:
    """Datagrams of a tracker that all come late, or none."""
    return (Fault("late", late_s=table.late_ms * MS),) if table.late_ms > 0.0 else ()


def path_answer(table: ScenarioControllerTable) -> PathAnswer:
    """Return the response of a controller's path to a correction."""
    return PathAnswer(table.dead_ms * MS, table.natural_hz, table.damping)


def timing(table: ScenarioControllerTable, gate_s: float) -> Timing:
    """Return the timing of a controller; ``gate_s`` where the scenario has none."""
    return Timing(
        realtime=table.realtime,
        wait_s=table.wait_s,
        gate_s=gate_s if table.gate_s is None else table.gate_s,
        answer_s=None if table.answer_ms is None else table.answer_ms * MS,
    )


def matrix(pose_mm_deg: Sequence[float]) -> Float:
    """Pose (4, 4) in m of x, y, z in mm and a, b, c in deg."""
    values = np.array(pose_mm_deg)
    return pose.from_xyz_zyx(values[:3] * MM, values[3:] * DEG)


def load(table: ForceSensorTable, record: Path | None, seed: int) -> NoisyWrench:
    """Return the load of a lone force sensor: a record, or a constant with a sine, and noise."""
    source: WrenchSource = SteadyWrench(np.array(table.wrench_n_nm), np.array(table.amplitude_n_nm), table.sine_hz)
    if record is not None:
        source = RecordedWrench(*read_wrench_log(record), repeat=table.repeat)
    return NoisyWrench(source, table.noise_n, table.noise_nm, seed)


def target(table: TargetTable) -> PoseSource:
    """Return the pose that a tracker measures, by time. Raises InputError: circle and square."""
    T, feed = matrix(table.pose_mm_deg), table.feed_mm_min * MM_PER_MIN
    radius, side = table.circle_radius_mm, table.square_side_mm
    if radius is not None and side is not None:
        raise InputError("two paths of a target", where="[target]", limit="circle_radius_mm or square_side_mm")
    if radius is not None:
        return CircleTarget(T, radius * MM, feed)
    return StandingTarget(T) if side is None else SquareTarget(T, side * MM, feed)


def impairment(table: NetworkTable) -> Impairment:
    """Return the faults of a network. Raises InputError: bursts that cannot be."""
    return Impairment(
        loss=table.loss,
        burst=Burst(table.burst_share, table.burst_mean) if table.burst_share else None,
        pattern=table.pattern,
        delay_s=table.delay_ms * MS,
        jitter_s=table.jitter_ms * MS,
        duplicate=table.duplicate,
        reorder=table.reorder,
        reorder_s=table.reorder_ms * MS,
        flip=table.flip,
        truncate=table.truncate,
        garbage=table.garbage,
        stalls=(Stall(table.stall_first, table.stall_count),) if table.stall_count else (),
        period_s=table.period_ms * MS,
        first=table.first,
    )
