"""The job `iso9283`: figures of ISO 9283 from raw measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from counterflex import __version__
from counterflex.app.robot_tests import pose_test
from counterflex.app.robot_tests.commanded import CommandedPoses, commanded_path
from counterflex.app.robot_tests.pose_test import MDEG
from counterflex.app.tracker_readings import AS_MEASURED, CommandFrame, TrackerMeasurement, read_measured
from counterflex.core import atomic
from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM, MM_PER_S, MS, PERCENT, UM
from counterflex.evaluate.iso9283.intervals import CONFIDENCE
from counterflex.evaluate.iso9283.path_cycles import REACH_M, CommandedPath, PathCycle, path_cycles
from counterflex.evaluate.iso9283.path_figures import Corner, IsoPathFigures, PathVelocity, corners, crossings
from counterflex.evaluate.iso9283.standstills import BAND_M
from counterflex.files.logs.tracker_exports.formats import OWN
from counterflex.files.summary_file import write_summary
from counterflex.geometry import pose

_FITS: Final = 20
_FITTED: Final = 1e-8  # A step of the fit that turns or moves by less (rad, m) is none


@dataclass(frozen=True, eq=False)
class PathResult:
    """A judged test."""

    path: CommandedPath
    cycles: list[PathCycle]
    figures: IsoPathFigures
    corners: list[Corner]
    velocity: PathVelocity | None  # Or None
    summary: dict[str, Any]
    table: pl.DataFrame  # One row for each place and cycle


def judge(
    measured: Sequence[TrackerMeasurement], path: CommandedPath, frame: CommandFrame, *, average_s: float
) -> PathResult:
    """Figures of a path test.

    Args:
        frame: From readings to commands; a fitted one is refined from the readings as they are.

    Raises:
        InputError: No cycle is corner_list, or a cycle has a hole.
    """
    moved = [one.averaged(average_s).moved(frame.T_command_log, frame.T_target_tcp) for one in measured]
    cycles = _cycles(moved, path)
    shift_m = 0.0
    if frame.fitted:
        T = _fitted(path, cycles)
        shift_m = float(np.linalg.norm(T[:3, 3]))
        cycles = _cycles([one.moved(T, np.eye(4)) for one in moved], path)
    figures = IsoPathFigures.of(path, cycles)
    corner_list = corners(path, cycles)
    velocity, why = _velocity(path, cycles)
    at, rt = figures.at_place, figures.rt_place
    summary: dict[str, Any] = {
        "test": "path",
        "cycles": len(cycles),
        "length_mm": round(float(path.length[-1]) / MM, 3),
        "corners": len(corner_list),
        "places": len(figures.length_m),
        "AT_um": figures.at_p.over(UM, 2),
        "AT_at_mm": round(float(figures.length_m[at]) / MM, 2),
        "RT_um": None if figures.rt_p is None else figures.rt_p.over(UM, 2),
        "RT_at_mm": None if rt is None else round(float(figures.length_m[rt]) / MM, 2),
    }
    summary |= {f"AT_{axis}_mdeg": f.over(MDEG, 3) for axis, f in zip("abc", figures.at_abc, strict=False)}
    summary |= {f"RT_{axis}_mdeg": f.over(MDEG, 3) for axis, f in zip("abc", figures.rt_abc, strict=False)}
    if frame.fitted:
        summary["fitted_shift_mm"] = round(shift_m / MM, 4)
    if corner_list:
        summary["CR_um"] = round(max(float(c.cr_m.max()) for c in corner_list) / UM, 2)
        summary["CO_um"] = round(max(float(c.co_m.max()) for c in corner_list) / UM, 2)
        summary["corner"] = [_corner_row(k, c) for k, c in enumerate(corner_list)]
    summary["velocity"] = _velocity_row(velocity) if velocity is not None else {"left_out": why}
    return PathResult(path, cycles, figures, corner_list, velocity, summary, _table(figures))


def _cycles(moved: Sequence[TrackerMeasurement], path: CommandedPath) -> list[PathCycle]:
    cycles = [
        cycle for one in moved for cycle in path_cycles(path, one.p, R=one.R, time_s=one.time_s)
    ]  # fmt: skip
    if not cycles:
        near = min(float(np.linalg.norm(one.p - path.p[0], axis=1).min()) for one in moved)
        raise InputError(
            "no attained path goes along the commanded one from its start to its end",
            where=", ".join(one.name for one in moved),
            value=f"the nearest reading is {near / MM:.3g} mm from the start",
            limit=f"within {REACH_M / MM:g} mm all along",
            hint="Are readings and commands in one frame? --frame with a cell file or X,Y,Z,A,B,C of the tracker",
        )
    return cycles


def _fitted(path: CommandedPath, cycles: Sequence[PathCycle]) -> Float:
    """Frame that carries the attained paths onto the commanded one, by least squares across it: ``T_command_log``."""
    s = path.places()
    c, t = path.at(s)
    if np.linalg.matrix_rank(c - c.mean(axis=0), tol=1e-4 * float(path.length[-1])) < 2:
        raise InputError("a frame cannot be fitted to a straight path", hint="Give --frame, or test a path in a plane")
    T = np.eye(4)
    for _ in range(_FITS):
        now = [PathCycle(x.first, pose.transform(T, x.p), x.length_m) for x in cycles]
        attained = np.stack([crossings(cycle, s, c, t) for cycle in now], axis=1)
        if np.isnan(attained).any():
            raise InputError("an attained path has a hole", hint="Readings are missing: was the beam interrupted?")
        step, _ = pose.register(c, attained.mean(axis=1))
        T = step @ T
        if float(np.abs(step - np.eye(4)).max()) < _FITTED:
            break
    return T


def _velocity(path: CommandedPath, cycles: Sequence[PathCycle]) -> tuple[PathVelocity | None, str]:
    if path.speed_m_s is None:
        return None, "the commanded velocity is not known (speed_mm_s of the table, or one F of the program)"
    if any(cycle.time_s is None for cycle in cycles):
        return None, "the readings have no usable times"
    try:
        return PathVelocity.of(path, cycles), ""
    except InputError as fault:
        return None, fault.what


def _velocity_row(v: PathVelocity) -> dict[str, Any]:
    unit = PERCENT * v.commanded_m_s
    return {
        "commanded_mm_s": round(v.commanded_m_s / MM_PER_S, 4),
        "AV_percent": v.av.over(unit, 3),
        "RV_percent": None if v.rv is None else v.rv.over(unit, 3),
        "FV_mm_s": round(v.fv_m_s / MM_PER_S, 4),
        "noise_mm_s": round(v.noise_m_s / MM_PER_S, 4),
    }


def _corner_row(k: int, c: Corner) -> dict[str, Any]:
    return {
        "corner": k + 1,
        "at_mm": round(c.length_m / MM, 2),
        "turn_deg": round(c.turn_rad / DEG, 2),
        "CR_um": round(float(c.cr_m.max()) / UM, 2),
        "CR_least_um": round(float(c.cr_m.min()) / UM, 2),
        "CO_um": round(float(c.co_m.max()) / UM, 2),
        "CO_least_um": round(float(c.co_m.min()) / UM, 2),
    }


def _table(f: IsoPathFigures) -> pl.DataFrame:
    m, n = f.p_attained.shape[:2]
    d = f.p_attained - f.command[:, None]
    columns: dict[str, Any] = {
        "place": np.repeat(np.arange(1, m + 1), n),
        "cycle": np.tile(np.arange(1, n + 1), m),
        "length_mm": np.repeat(f.length_m / MM, n),
    }
    columns |= {f"{axis}_mm": f.p_attained[..., i].ravel() / MM for i, axis in enumerate("xyz")}
    columns |= {f"deviation_{axis}_um": d[..., i].ravel() / UM for i, axis in enumerate("xyz")}
    if f.turned_rad is not None:
        columns |= {f"deviation_{axis}_mdeg": f.turned_rad[..., i].ravel() / MDEG for i, axis in enumerate("abc")}
    columns["AT_um"] = np.repeat(f.by_place_at_m / UM, n)
    columns["RT_um"] = np.repeat(f.by_place_rt_m / UM, n)
    return pl.DataFrame(columns)


_UNITS: Final = {"_um": "um", "_mdeg": "mdeg", "_percent": "%", "_mm_s": "mm/s", "_s": "s"}
_SINGLE: Final = ("CR_um", "CO_um", "FV_mm_s", "overshoot_um", "stabilisation_time_s")
"""Figures without an interval: the largest over cycles or places, or a mean of three."""

CYCLES: Final = {"pose": 30, "path": 10}
"""Cycles that the standard measures."""


def run(
    files: Sequence[str | Path],
    out: str | Path | None = None,
    *,
    poses: str | Path | None = None,
    path: str | Path | None = None,
    frame: str = AS_MEASURED,
    form: str = OWN,
    average_ms: float = 0.0,
    band_mm: float = BAND_M / MM,
    by_direction: bool = False,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Judge measurements by ISO 9283; with ``out``, write tables, ``summary.json`` and ``report.html`` there.

    Args:
        out: Folder, made when missing; None writes nothing.
        poses: Commanded poses: a table, or a program that dwells at them; None where datasets state them.
        path: Commanded path: a table or a program. With it the path test is judged, without it the pose test.
        by_direction: Every file holds the cycles from another direction of approach.

    Raises:
        CounterflexError: A file cannot be used, or does not hold the test.
    """
    if poses is not None and path is not None:
        raise InputError("poses and a path are given", where="--poses and --path", hint="Give one of them")
    place = CommandFrame.of(frame)
    measured = []
    for k, file in enumerate(files):
        measured.append(read_measured(file, form))
        progress(0.4 * (k + 1) / len(files), f"reading {Path(file).name}")
    seconds = average_ms * MS
    result: pose_test.PoseResult | PathResult
    if path is not None:
        result = judge(measured, commanded_path(path), place, average_s=seconds)
    else:
        commanded = None if poses is None else CommandedPoses.of(poses)
        result = pose_test.judge(
            measured, commanded, place, average_s=seconds, band_m=band_mm * MM, by_direction=by_direction
        )
    progress(0.9)
    summary = {
        "job": "iso9283",
        "standard": "ISO 9283:1998",
        "files": [one.name for one in measured],
        "commanded": Path(str(poses or path)).name if poses or path else "stated by the dataset",
        "frame": place.text,
        "frame_fitted": place.fitted,
        "filter": f"moving mean over {average_ms:g} ms" if average_ms > 0.0 else "none",
        "limit_band_mm": band_mm,
        "confidence": CONFIDENCE,
        "tracker_sigma_um": round(max(one.sigma_m for one in measured) / UM, 3),
        **result.summary,
        "cycles_of_the_standard": CYCLES[result.summary["test"]],
        "counterflex": __version__,
    }
    if out is not None:
        with atomic.atomic_folder(out) as staging:
            atomic.write_made(staging / "attained.parquet", result.table.write_parquet)
            atomic.write_text(staging / "attained.csv", result.table.write_csv())
            atomic.write_text(staging / "figures.csv", figure_table(summary).write_csv())
            write_summary(staging / "summary.json", summary)
            _write_page(result, summary, staging / "report.html")
    progress(1.0)
    return summary


def figure_table(summary: dict[str, Any]) -> pl.DataFrame:
    """All figures of a summary with their intervals: ``figure, where, unit, value, low, high, cycles``."""
    parts = [("", summary)]
    for name, label in (("poses", "pose"), ("multi_directional", "pose"), ("corner", "corner")):
        parts += [(f"{label} {row[label]}", row) for row in summary.get(name, [])]
    parts += [(f"poses {row['from']} and {row['to']}", row) for row in summary.get("distances", [])]
    parts.append(("middle of the path", summary.get("velocity", {})))
    rows = []
    for where, part in parts:
        for key, value in part.items():
            ending = next((end for end in _UNITS if key.endswith(end)), None)
            if ending is None:
                continue
            head: dict[str, Any] = {"figure": key.removesuffix(ending), "where": where, "unit": _UNITS[ending]}
            if isinstance(value, dict):
                rows.append(head | value)
            elif isinstance(value, float) and key in _SINGLE:
                rows.append(head | {"value": value})
    schema = {"figure": pl.String, "where": pl.String, "unit": pl.String, "value": pl.Float64, "low": pl.Float64,
              "high": pl.Float64, "cycles": pl.Int64}  # fmt: skip
    return pl.DataFrame(rows, schema=schema)


def _write_page(result: pose_test.PoseResult | PathResult, summary: dict[str, Any], target: Path) -> None:
    from counterflex.report.page import write_page
    from counterflex.report.robot_tests import page

    if isinstance(result, pose_test.PoseResult):
        write_page(page.pose_page(summary, result.poses), target)
    else:
        write_page(page.path_page(summary, result.path, result.figures, result.cycles, result.velocity), target)
