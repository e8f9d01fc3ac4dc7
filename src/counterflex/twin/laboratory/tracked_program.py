"""The simulated laboratory watches the robot run a program in the air: a log of the tracker, in the part frame.

The tracker was registered to the part by five points about the path, and its target to the tool tip, each by the mean
of twenty readings: what a program of a tracker exports in its working frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import ToolPath
from counterflex.twin.laboratory.laboratory import Laboratory
from counterflex.twin.plant.controller import Controller
from counterflex.twin.plant.simulate import simulate
from counterflex.twin.truth.truth import Truth

READINGS: Final = 20
_ABOUT_M: Final = 200.0 * MM
_BELOW_M: Final = 500.0 * MM


@dataclass(frozen=True, eq=False)
class TrackedProgram:
    """What the tracker logged.

    Attributes:
        time_s: (n,) s, one reading for each cycle of the controller.
        Ts_part_tcp: (n, 4, 4) m, the tool in the part frame as registered, with the noise of the readings.
        sigma_m: Standard deviation of a position, per axis.
    """

    time_s: Float
    Ts_part_tcp: Float
    sigma_m: float


def track(
    path: ToolPath,
    *,
    truth: Truth,
    laboratory: Laboratory,
    controller: Controller,
    cutter: Cutter | Mapping[int, Cutter],
    datum_points_part: Float | None = None,
    cycles: int = 1,
    progress: Progress,
) -> TrackedProgram:
    """Run a program several times without a blank and log it.

    ``cycles``: How often the program runs, without a pause. ``progress``: Progress callback, fraction 0 to 1.

    Raises:
        InputError: The program is empty, or runs less than once.
        ReachError: The robot cannot reach it.
        SimulationError: The simulated cell left its physical range.
    """
    if cycles < 1:
        raise InputError("cycles of a program", value=cycles, limit=">= 1")
    record = simulate(
        repeated(path, cycles),
        truth=truth,
        controller=controller,
        stock=_nothing_below(path),
        cutter=cutter,
        datum_points_part=datum_points_part,
        skip_air=False,
        progress=progress,
    )
    noise = laboratory.noise("tracked_program")
    each = laboratory.tracker_m / np.sqrt(READINGS)
    centre = record.p_part_command.mean(axis=0)
    points = centre + _ABOUT_M * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
    T_registered, _ = pose.register(points, points + each * noise.standard_normal((5, 3)))
    target_off = each * noise.standard_normal(3)
    n = len(record.time_s)
    command = controller.tool_poses(record.p_part_command, np.tile([0.0, 0.0, 1.0], (n, 1)))
    Rs = rotation.exp(record.tilt_part) @ command[:, :3, :3]
    p = record.p_part_tcp + Rs @ target_off + laboratory.tracker_m * noise.standard_normal((n, 3))
    measured = pose.make(rotation.exp(laboratory.tracker_rad * noise.standard_normal((n, 3))) @ Rs, p)
    return TrackedProgram(record.time_s, T_registered @ measured, laboratory.tracker_m)


def repeated(path: ToolPath, cycles: int) -> ToolPath:
    """A path run several times, one after the other, with a straight move from its end to its beginning."""
    if len(path) < 2:
        raise InputError("a program of fewer than two points cannot be run", value=len(path))
    columns = {field.name: getattr(path, field.name) for field in fields(path)}
    time, motion = columns["time_s"], columns["motion"]
    length, moves = float(time[-1]), int(motion[-1]) + 1
    out = {name: np.concatenate([values] * cycles) for name, values in columns.items()}
    out["time_s"] = np.concatenate([time + k * length for k in range(cycles)])
    out["motion"] = np.concatenate([motion + k * moves for k in range(cycles)])
    return replace(path, **out)


def _nothing_below(path: ToolPath) -> HeightMap:
    """A blank far below the path: the tool meets nothing."""
    z = float(path.p_part_tcp[:, 2].min()) - _BELOW_M
    x, y = path.p_part_tcp[:, :2].min(axis=0)
    return HeightMap(float(x), float(y), 1.0 * MM, np.full((16, 16), z, dtype=np.float32), z - 1.0 * MM)
