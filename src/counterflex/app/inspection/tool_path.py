"""The path of the tool judged: a log laid on the program's path, and the part that it would leave."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.app.inputs import Job
from counterflex.app.inspection.tool_log import ToolLog
from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.cutting.removal import remove_path
from counterflex.evaluate.inspection.nominal_part import NominalPart
from counterflex.evaluate.inspection.registration import Registration, aligned
from counterflex.evaluate.path_deviation import PathDeviation, PathFigures, path_deviation, path_figures
from counterflex.evaluate.tool_path.curve import curve_of
from counterflex.evaluate.tool_path.pose_search import COVERED, diagnosed, score, searched
from counterflex.evaluate.tool_path.readings import ToolReadings
from counterflex.evaluate.tool_path.registration import fitted
from counterflex.evaluate.tool_path.swept_part import SweptPart, surfaces_made, swept_part
from counterflex.evaluate.tool_path.tracked_path import TrackedPath, of_program, tracked_path
from counterflex.files.cell.cell import Cell
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.twin.plant.simulate import mounted_tools

NOISIEST_M: Final = 0.3 * MM
"""Standard deviation of a reading above which a log is none of a path."""
_FITS: Final = 12
_STILL_M: Final = 1e-8
_CONDITION: Final = 1000.0
"""Worse than this the motion in air does not hold the frame, and all of the path is fitted."""


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
        return path_figures(self.track.deviation)

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
