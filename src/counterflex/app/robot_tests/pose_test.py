"""The pose test of ISO 9283: readings to attained poses, figures of every pose, in shop units."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl

from counterflex.app.robot_tests.commanded import CommandedPoses
from counterflex.app.tracker_readings import CommandFrame, TrackerMeasurement
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.evaluate.iso9283 import standstills as still
from counterflex.evaluate.iso9283.poses import DistanceFigures, PoseCycles, PoseFigures, drift, multi_directional
from counterflex.evaluate.iso9283.standstills import Settled
from counterflex.geometry import pose

MDEG: Final = 1e-3 * DEG
_ALL_PAIRS: Final = 5  # Up to this many poses all their distances are judged; of more, those of neighbours
_DISCRETE_S: Final = 0.5
_SETTLINGS: Final = 3  # Approaches of a pose that the standard takes the stabilisation time from


@dataclass(frozen=True, eq=False)
class Attained:
    """Attained poses of one file."""

    poses: list[PoseCycles]  # Of every commanded pose
    settling: list[list[Settled]]  # Of every pose, its approaches where the log shows them
    refused: dict[str, int]  # Why approaches were not used, by reason

    @classmethod
    def of(
        cls,
        one: TrackerMeasurement,
        commanded: CommandedPoses | None,
        frame: CommandFrame,
        average_s: float,
        band_m: float,
    ) -> Attained:
        """Attained poses of all cycles, from the readings."""
        if one.pose is not None:
            return cls(_stated(one, commanded, frame), [], {})
        if commanded is None:
            raise InputError("the commanded poses are not known", where=one.name, hint="Give --poses")
        averaged = one.averaged(average_s)
        if one.time_s is None or float(np.median(np.diff(one.time_s))) > _DISCRETE_S:
            R = one.R
            stands = [
                still.MeasuredStandstill(
                    k, k, one.p[k], None if R is None else R[k], float(k if one.time_s is None else one.time_s[k])
                )
                for k in range(len(one.Ts_command_tcp))
            ]
        else:
            assert averaged.time_s is not None
            stands = still.standstills(averaged.time_s, averaged.p, averaged.R)
        if frame.fitted:
            T = still.fitted_frame(stands, commanded.Ts_command)
            fitted = replace(frame, T_command_log=T)
        else:
            fitted = frame
        T = fitted.T_command_log
        moved = averaged.moved(T, fitted.T_target_tcp)
        stands = [_moved(stand, T, fitted.T_target_tcp, oriented=averaged.oriented) for stand in stands]
        which = still.assigned(stands, commanded.Ts_command)
        cycles = still.ordered_cycles(which, len(commanded.Ts_command))
        if not cycles:
            raise InputError(
                "no cycle goes through all commanded poses in their order",
                where=one.name,
                value=f"{len(stands)} standstills, {int(np.sum(which >= 0))} within {still.NEAR_M / MM:g} mm of a "
                "commanded pose",
                hint="Are readings and commands in one frame? --frame fit, a cell file, or X,Y,Z,A,B,C",
            )
        poses = _oriented(still.pose_cycles(stands, cycles, commanded.Ts_command), commanded, frame)
        settling, refused = _settling(moved, stands, cycles, len(commanded.Ts_command), band_m)
        return cls(poses, settling, refused)


@dataclass(frozen=True, eq=False)
class PoseResult:
    """A judged test."""

    poses: list[PoseCycles]  # Attained poses, all files together (or by direction one after the other)
    figures: list[PoseFigures]  # Of each pose
    summary: dict[str, Any]
    table: pl.DataFrame  # One row for each pose and cycle


def judge(
    measured: Sequence[TrackerMeasurement],
    commanded: CommandedPoses | None,
    frame: CommandFrame,
    *,
    average_s: float,
    band_m: float,
    by_direction: bool,
) -> PoseResult:
    """Figures of a pose test.

    Args:
        commanded: Commanded poses; None where datasets state them.
        average_s: Moving mean over the readings of a log.
        by_direction: Every file holds cycles from another direction of approach.

    Raises:
        InputError: The readings do not hold the poses.
    """
    files = [Attained.of(one, commanded, frame, average_s, band_m) for one in measured]
    groups = _by_stated_direction(measured[0], files[0]) if len(measured) == 1 else [file.poses for file in files]
    several = by_direction or len(groups) > len(files)
    counts = [len(group) for group in groups]
    if min(counts) < max(counts):
        raise InputError("the files hold other numbers of poses", value=counts)
    by_pose = list(zip(*groups, strict=True))
    joined = [_joined(cycles) for cycles in by_pose]
    figures = list(map(PoseFigures.of, joined))
    summary: dict[str, Any] = {
        "test": "pose",
        "cycles": min(len(one.p) for one in joined),
        "poses": [_pose_row(k, *of, files) for k, of in enumerate(zip(joined, figures, strict=True))],
        "distances": _distances(joined),
        "settling_refused": _sum([file.refused for file in files]),
    }
    if several and len(groups) > 1:
        summary["multi_directional"] = [_direction_row(k, cycles) for k, cycles in enumerate(by_pose)]
        summary["directions"] = len(groups)
    return PoseResult(joined, figures, summary, _table(joined))


def _distances(joined: Sequence[PoseCycles]) -> list[dict[str, Any]]:
    numbers = range(len(joined))
    pairs = itertools.pairwise(numbers) if len(joined) > _ALL_PAIRS else itertools.combinations(numbers, 2)
    return [_distance_row(i, j, joined) for i, j in pairs if len(joined[i].p) == len(joined[j].p)]


def _moved(
    stand: still.MeasuredStandstill, T: Float, T_target_tcp: Float, *, oriented: bool
) -> still.MeasuredStandstill:
    at = T @ pose.make(stand.R if oriented else None, stand.p) @ T_target_tcp
    return replace(stand, p=at[:3, 3], R=at[:3, :3] if oriented else None)


def _oriented(poses: list[PoseCycles], commanded: CommandedPoses, frame: CommandFrame) -> list[PoseCycles]:
    """Orientations only where they were commanded; in a fitted frame about their mean offset."""
    if not commanded.oriented:
        return [replace(one, R=None) for one in poses]
    if frame.fitted and all(one.R is not None for one in poses):
        offset = still.fitted_offset(poses)
        return [replace(one, R=None if one.R is None else one.R @ offset) for one in poses]
    return poses


def _own_command(one: TrackerMeasurement, count: int) -> CommandedPoses:
    """Commanded poses as a dataset states them."""
    if one.command is None or one.pose is None:
        raise InputError(
            "the commanded poses are not known", where=one.name, hint="Give --poses, or a channel p_base_command"
        )
    first = [int(np.argmax(one.pose == k)) for k in range(count)]
    return CommandedPoses(one.command[first], one.commanded_oriented)


def _stated(one: TrackerMeasurement, commanded: CommandedPoses | None, frame: CommandFrame) -> list[PoseCycles]:
    """Poses of a dataset that states which row belongs to which."""
    assert one.pose is not None
    count = int(one.pose.max()) + 1 if commanded is None else len(commanded.Ts_command)
    missing = [k + 1 for k in range(count) if not np.any(one.pose == k)]
    if missing or int(one.pose.min()) < 0 or int(one.pose.max()) >= count:
        raise InputError(
            "numbers of the commanded poses", where=one.name, value=sorted(set((one.pose + 1).tolist()))[:8],
            limit=f"each of 1 to {count}",
        )  # fmt: skip
    if commanded is None:
        commanded = _own_command(one, count)
    T = frame.T_command_log
    if frame.fitted:
        means = np.stack([one.p[one.pose == k].mean(axis=0) for k in range(count)])
        T, _ = pose.register(commanded.Ts_command[:, :3, 3], means)
    moved = one.moved(T, frame.T_target_tcp)
    time_s, R = one.time_s, moved.R
    poses = [
        PoseCycles(T_command, moved.p[row], None if R is None else R[row], None if time_s is None else time_s[row])
        for T_command, row in zip(commanded.Ts_command, [one.pose == k for k in range(count)], strict=False)
    ]
    return _oriented(poses, commanded, frame)


def _by_stated_direction(measured: TrackerMeasurement, attained: Attained) -> list[list[PoseCycles]]:
    if measured.pose is None or measured.direction is None:
        return [attained.poses]
    by_pose = [measured.direction[measured.pose == k] for k in range(len(attained.poses))]
    return [
        [one.part(np.flatnonzero(at == direction)) for one, at in zip(attained.poses, by_pose, strict=True)]
        for direction in np.unique(measured.direction)
    ]


def _settling(
    moved: TrackerMeasurement,
    stands: Sequence[still.MeasuredStandstill],
    cycles: Sequence[Sequence[int]],
    count: int,
    band_m: float,
) -> tuple[list[list[Settled]], dict[str, int]]:
    """Stabilisation of the approaches of every pose, where the log shows them."""
    out: list[list[Settled]] = [[] for _ in range(count)]
    refused: dict[str, int] = {}
    if moved.time_s is None:
        return out, refused
    for cycle in cycles:
        for k, number in enumerate(cycle):
            before = stands[number - 1] if number else None
            try:
                out[k].append(Settled.of(moved.time_s, moved.p, before, stands[number], band_m))
            except InputError as fault:
                refused[fault.what] = refused.get(fault.what, 0) + 1
    return out, refused


def _joined(parts: Sequence[PoseCycles]) -> PoseCycles:
    if len(parts) == 1:
        return parts[0]
    Rs = [part.R for part in parts if part.R is not None]
    times = [part.time_s for part in parts if part.time_s is not None]
    return PoseCycles(
        parts[0].command,
        np.concatenate([part.p for part in parts]),
        np.concatenate(Rs) if len(Rs) == len(parts) else None,
        np.concatenate(times) if len(times) == len(parts) == 1 else None,
    )


def _pose_row(k: int, one: PoseCycles, f: PoseFigures, files: Sequence[Attained]) -> dict[str, Any]:
    row: dict[str, Any] = {
        "pose": k + 1,
        "commanded_mm": [round(float(x) / MM, 4) for x in one.command[:3, 3]],
        "cycles": len(one.p),
        "AP_um": f.ap.over(UM, 2),
    }
    row |= {f"AP_{axis}_um": figure.over(UM, 2) for axis, figure in zip("xyz", f.ap_xyz, strict=True)}
    row |= {f"AP_{axis}_mdeg": figure.over(MDEG, 3) for axis, figure in zip("abc", f.ap_abc, strict=False)}
    if f.rp is not None:
        row["RP_um"] = f.rp.over(UM, 2)
    row |= {f"RP_{axis}_mdeg": figure.over(MDEG, 3) for axis, figure in zip("abc", f.rp_abc, strict=False)}
    approaches = [s for file in files if file.settling for s in file.settling[k]][:_SETTLINGS]
    if len(approaches) == _SETTLINGS:
        row["stabilisation_time_s"] = round(float(np.mean([s.time_s for s in approaches])), 4)
        row["overshoot_um"] = round(max(s.overshoot_m for s in approaches) / UM, 2)
    moved = drift(one)
    if moved is not None:
        row["drift"] = {
            "dAP_um": round(moved.dap_m / UM, 2),
            "dRP_um": round(moved.drp_m / UM, 2),
            "barycentre_um": round(moved.moved_m / UM, 2),
            "hours": round(float(moved.time_s[-1] - moved.time_s[0]) / 3600.0, 3),
            "blocks": len(moved.ap_m),
        }
    return row


def _distance_row(i: int, j: int, poses: Sequence[PoseCycles]) -> dict[str, Any]:
    f = DistanceFigures.of(poses[i], poses[j])
    row: dict[str, Any] = {
        "from": i + 1,
        "to": j + 1,
        "commanded_mm": round(f.commanded_m / MM, 4),
        "AD_um": f.ad.over(UM, 2),
    }
    if f.rd is not None:
        row["RD_um"] = f.rd.over(UM, 2)
    row |= {f"AD_{axis}_um": figure.over(UM, 2) for axis, figure in zip("xyz", f.ad_xyz, strict=True)}
    row |= {f"RD_{axis}_um": figure.over(UM, 2) for axis, figure in zip("xyz", f.rd_xyz, strict=False)}
    return row


def _direction_row(k: int, directions: Sequence[PoseCycles]) -> dict[str, Any]:
    position, angles = multi_directional(directions)
    row: dict[str, Any] = {"pose": k + 1, "vAP_um": position.over(UM, 2)}
    return row | {f"vAP_{axis}_mdeg": figure.over(MDEG, 3) for axis, figure in zip("abc", angles, strict=False)}


def _sum(parts: Sequence[dict[str, int]]) -> dict[str, int]:
    out: dict[str, int] = {}
    for part in parts:
        for reason, count in part.items():
            out[reason] = out.get(reason, 0) + count
    return out


def _table(poses: Sequence[PoseCycles]) -> pl.DataFrame:
    rows = []
    for k, one in enumerate(poses):
        d = one.p - one.command[:3, 3]
        turned = one.turned
        for j in range(len(one.p)):
            row: dict[str, Any] = {"pose": k + 1, "cycle": j + 1}
            row |= {f"{axis}_mm": float(one.p[j, i]) / MM for i, axis in enumerate("xyz")}
            row |= {f"deviation_{axis}_um": float(d[j, i]) / UM for i, axis in enumerate("xyz")}
            row["from_barycentre_um"] = float(np.linalg.norm(one.p[j] - one.p.mean(axis=0))) / UM
            if turned is not None:
                row |= {f"deviation_{axis}_mdeg": float(turned[j, i]) / MDEG for i, axis in enumerate("abc")}
            if one.time_s is not None:
                row["time_s"] = float(one.time_s[j])
            rows.append(row)
    return pl.DataFrame(rows)
