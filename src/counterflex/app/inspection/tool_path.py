"""The path of the tool judged: a log laid on the program's path, and the part that it would leave."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from counterflex.app.inputs import Job
from counterflex.app.inspection.tool_log import ToolLog
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM, plain
from counterflex.cutting.removal import remove_path
from counterflex.evaluate.figures import DeviationFigures
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.inspection.registration import Registration, aligned
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures, path_deviation
from counterflex.evaluate.tool_path.curve import curve_of
from counterflex.evaluate.tool_path.pose_search import COVERED, diagnosed, score, searched
from counterflex.evaluate.tool_path.readings import ToolReadings
from counterflex.evaluate.tool_path.registration import fitted
from counterflex.evaluate.tool_path.swept_part import SweptPart, surfaces_made, swept_part
from counterflex.evaluate.tool_path.tracked_path import TrackedPath, of_program, tracked_path
from counterflex.files.cell.cell import Cell
from counterflex.files.tool_path_file import ToolPathRows
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.twin.plant.simulate import mounted_tools

NOISIEST_M: Final = 0.3 * MM
"""Standard deviation of a reading above which a log is none of a path."""
_FITS: Final = 12
_STILL_M: Final = 1e-8
_CONDITION: Final = 1000.0  # Worse than this the motion in air does not hold the frame, and all of the path is fitted


@dataclass(frozen=True, eq=False)
class InspectedPath:
    """A log of the tool's path, judged."""

    file: str
    log: ToolLog
    part: SweptPart
    # By each station, (k,) whether it makes a floor, a wall on its left, a wall on its right
    made: tuple[Bool, Bool, Bool]

    @property
    def track(self) -> TrackedPath:
        """The measured path."""
        return self.part.track

    @property
    def figures(self) -> PathFigures:
        """Of the path."""
        return PathFigures.of(self.track.deviation)

    def normal_m(self) -> dict[str, Float]:
        """Deviation along the normals of the surfaces that each station makes, (k,) m, positive = material left.

        nan where a station makes no such surface. A floor is off as the tool is along its axis, a wall on the left by
        as much as the tool is too far to the right.
        """
        deviation = self.track.deviation
        values = (deviation.across_axis_m, -deviation.across_left_m, deviation.across_left_m)
        names = ("floor", "wall_left", "wall_right")
        return {name: np.where(on, v, np.nan) for name, on, v in zip(names, self.made, values, strict=True)}


def judged_path(log: ToolLog, part: NominalPart, job: Job, cell: Cell) -> InspectedPath:
    """Lay a log on the program's path and judge it. Raises InputError: the log does not fit the program's path."""
    path, radius = job.path, part.surface.cutter.radius_m
    noise = log.readings.noise_m()
    if noise > NOISIEST_M:
        raise InputError(
            "the readings scatter too much for a path",
            where=log.file,
            value=f"{noise / MM:.2f} mm from one to the next",
            limit=f"<= {NOISIEST_M / MM:g} mm",
            hint="Are they in the order of time, and of one target?",
        )
    engagement = contact_of(path, cell) if log.cut else None
    T, registration = _placed(log, part, path, radius, engagement)
    readings = of_program(path, log.readings.moved(T))
    track = tracked_path(path, readings, radius, engagement, log.file)
    if track.covered < COVERED:
        raise InputError(
            "the log follows only a part of the program's path",
            where=log.file,
            value=f"{100.0 * track.covered:.0f} % of its feed motion",
            limit=f">= {100.0 * COVERED:g} %",
            hint="Log the whole program; was the beam interrupted, or another program run?",
        )
    tool = mounted_tools(path)
    swept = swept_part(part, path, tool, cell.cutter, track, registration)
    return InspectedPath(log.file, log, swept, surfaces_made(part, track, swept.outline[:, 0]))


def _placed(
    log: ToolLog, part: NominalPart, path: ToolPath, radius: float, engagement: Float | None
) -> tuple[Float, Registration]:
    """Pose of the log in the part frame; fitted to the motion in air alone where that is known and enough."""
    feed = np.asarray(path.kind) == FEED
    program = curve_of(path.p_part_tcp)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1))])
    row = np.clip(np.searchsorted(lengths, program.pitch_m * np.arange(len(program))), 1, len(lengths) - 1)
    fed = feed[row].astype(np.float64)
    curve = curve_of(log.readings.p)
    if not log.fitted:
        if score(program, fed, curve, np.eye(4)).share < COVERED:
            raise diagnosed(program, fed, curve, log.file)
        return np.eye(4), aligned(part, np.eye(4))
    T = searched(program, fed, curve, log.file).T_path_log
    registration, in_air = aligned(part, T), engagement is not None
    for _ in range(_FITS):
        deviation = _matched(path, of_program(path, log.readings.moved(T)), radius)
        cut = None
        if in_air and engagement is not None:
            row = np.clip(np.searchsorted(lengths, deviation.length_m), 1, len(lengths) - 1)
            cut = engagement[row] > 0.0
        try:
            registration = fitted(deviation, T, log.file, cut)
            in_air &= registration.condition < _CONDITION
        except InputError:
            if not in_air:
                raise
            in_air = False
            continue
        step = float(np.abs(registration.T_part_scan - T).max())
        T = registration.T_part_scan
        if step < _STILL_M:
            break
    return T, registration


def _matched(path: ToolPath, readings: ToolReadings, radius: float) -> PathDeviation:
    """The readings on the path, as they are."""
    noise = readings.noise_m()
    clock = readings.clock_s - readings.clock_s[0]
    return path_deviation(path, clock, readings.p, np.ones(len(readings)), radius, spacing_m=max(0.2 * MM, 4.0 * noise))


def contact_of(path: ToolPath, cell: Cell) -> Float:
    """(n,) m2, what the undisturbed tool removes on the way to each row by its length; 0 in air and in rapids."""
    stock, tool = cell.stock(), mounted_tools(path)
    out = np.zeros(len(path))
    length = np.linalg.norm(np.diff(path.p_part_tcp, axis=0), axis=1)
    changes = np.flatnonzero(np.diff(tool[1:])) + 1
    for first, last in itertools.pairwise([0, *changes.tolist(), len(path) - 1]):
        if last > first:
            some = slice(first, last + 1)
            cutter = cell.cutter(int(tool[last]))
            volume = remove_path(stock, path.p_part_tcp[some], path.kind[some], cutter, engagement=False).volume_m3
            steps = length[first:last]
            out[first + 1 : last + 1] = np.where(steps > 0.0, volume / np.where(steps > 0.0, steps, 1.0), 0.0)
    out[np.asarray(path.kind) != FEED] = 0.0
    return out


def path_entry(one: InspectedPath) -> dict[str, Any]:
    """The entries ``log`` and ``path`` of a part: how it was logged, and the figures of the path."""
    track, log, figures = one.track, one.log, one.figures
    spacing = track.deviation.spacing_m
    path: dict[str, Any] = {
        name: _figures(getattr(figures, name)) for name in ("path", "entry", "exit", "plateau", "air")
    }
    if not track.cut_known:
        path = {"path": path["path"]}
    if track.clock:
        path["along"] = _figures(figures.along)
    normal = {name: v[np.isfinite(v)] for name, v in one.normal_m().items()}
    path["normal"] = {name: _figures(DeviationFigures.weighted(v, spacing)) for name, v in normal.items() if len(v)}
    for name, v in normal.items():
        if len(v):
            path["normal"][name]["mean_mm"] = round(float(v.mean()) / MM, 4)
    return {
        "log": {
            "file": one.file,
            **plain(log, "kind position frame frame_fitted=fitted"),
            "readings": len(log.readings),
            "noise_um": round(track.noise_m / UM, 2),
            "stated_sigma_um": round(log.stated_sigma_m / UM, 2),
            "smoothed_over_mm": round(track.window_m / MM, 2),
            "covered_percent": round(100.0 * track.covered, 1),
            "left_out_percent": round(100.0 * track.left_out, 1),
            "cutting": "by the program's removal" if track.cut_known else "not known: all feed motion counts",
            "along_counts_from": track.clock or "not known",
            **log.facts,
        },
        "path": path,
    }


def path_rows(one: InspectedPath, job: Job, cell: Cell) -> ToolPathRows:
    """The stations of a path, in part axes, with their deviations."""
    track, registration = one.track, one.part.registration
    deviation = track.deviation
    axis = np.cross(deviation.feed_direction, deviation.left)
    place = deviation.p_part_nominal
    by_pose = np.maximum(
        registration.standard_deviation_m(place, deviation.left), registration.standard_deviation_m(place, axis)
    )
    along = deviation.along_m if track.clock else np.full(len(place), np.nan)
    fed = deviation.cutting | deviation.air
    cutting = deviation.cutting.astype(np.int64) if track.cut_known else np.where(fed, -1, 0)
    return ToolPathRows(
        deviation.time_s,
        deviation.length_m,
        np.asarray(job.line_of_motion, dtype=np.int64)[deviation.motion],
        place if cell.R_part_plane is None else place @ cell.R_part_plane.T,
        np.column_stack([deviation.across_left_m, deviation.across_axis_m, along]),
        np.column_stack(list(one.normal_m().values())),
        np.sqrt(track.sigma_m**2 + by_pose**2),
        cutting,
    )


def _figures(figures: DeviationFigures) -> dict[str, float]:
    return plain(figures, "max_mm:4 p997_mm:4 rms_mm:4") | {"length_mm": round(figures.extent / MM, 1)}
