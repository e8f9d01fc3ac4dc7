"""Test cuts on the simulated cell: the robot mills them, the flange sensor records.

The cell machines the requested cuts with everything that the force model lacks: the tool bends away, so depth and
width are not the commanded ones; the edge ploughs, the teeth run out, drives play and rub, the blank is higher than
stated. The sensor between flange and spindle feels the process force, the weight and the inertia of all that hangs
behind it, adds a bias that drifts, and noise; its readings are turned into base axes with the orientation that the
controller believes in. Weight and bias are left in: what was shown in air before and after each cut takes them out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, share_of
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose, rotation
from counterflex.path.toolpath import ToolPath
from counterflex.robot.model.description import Opw
from counterflex.twin.laboratory.laboratory import Laboratory, Measured, Measurement, Order
from counterflex.twin.laboratory.slot_path import StraightCuts, engaged, slot_path, straight_cuts
from counterflex.twin.plant.controller import Controller
from counterflex.twin.plant.record import Record
from counterflex.twin.plant.simulate import simulate
from counterflex.twin.truth.truth import Truth

# The simulated laboratory watches the robot run a program in the air: a log of the tracker, in the part frame.
# The tracker was registered to the part by five points about the path, and its target to the tool tip, each by the mean
# of twenty readings: what a program of a tracker exports in its working frame.

READINGS: Final = 20
_ABOUT_M: Final = 200.0 * MM
_BELOW_M: Final = 500.0 * MM


@dataclass(frozen=True, eq=False)
class TrackedProgram:
    """Log of the tracker."""

    time_s: Float  # (n,) s, one reading for each cycle of the controller
    Ts_part_tcp: Float  # (n, 4, 4) m, the tool in the part frame as registered, with the noise of the readings
    sigma_m: float  # standard deviation of a position, per axis

    @classmethod
    def of(
        cls,
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
        return cls(record.time_s, T_registered @ measured, laboratory.tracker_m)


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


BIAS_N = 20.0
"""Standard deviation of the sensor's zero, per axis."""
DRIFT_N = 2.0
"""Standard deviation of what the zero drifts over the whole program, per axis."""
RATE_HZ = 50.0
DEPTH_GAUGE_M = 15.0 * UM
_SENSOR = "sensor"
_AIR_S = 1.0
_CALM_S = 0.3  # after a stretch of the simulation begins: its start is no motion of a real machine


@Measurement
def measure(order: Order) -> Measured:
    """Mill the test cuts and record force, pose and what the program says, at a steady rate.

    ``order``: Request: Columns of :data:`counterflex.twin.laboratory.slot_path.COLUMNS`, one straight feed motion a
    row, SI. Settings: What the machine is told, plain values as the recipe proposes them: geometry, tool and part frame
    of the controller, ``cutter_...``, ``blank_...``; ``datum_points_m`` touched by the robot, ``rate_hz`` of the
    record, ``measure_depth`` to gauge the finished slots.

    Returns:
        Channels ``time_s``, ``f_tcp_base``, ``q``, ``feed_direction``, ``feed_rate``, ``spindle_speed``, ``depth``,
        ``width``, ``tool``, ``blank`` and, when gauged, ``depth_measured``; grouped by cut.

    Raises:
        InputError: A value is missing, or the cuts never meet the blank.
    """
    truth, laboratory, request, settings, progress = order
    cuts = straight_cuts(request)
    rng = laboratory.noise("slots")
    bias = BIAS_N * rng.standard_normal(3)
    parts: list[Measured] = []
    blanks = np.unique(cuts.blank)
    for k, blank in enumerate(blanks):
        mine = cuts.subset(cuts.blank == blank)
        part = share_of(progress, k / len(blanks), (k + 1) / len(blanks))
        parts.append(_one_blank(truth, laboratory, mine, settings, bias, rng, part))
    joined = {name: np.concatenate([p.channels[name] for p in parts]) for name in parts[0].channels}
    return Measured(joined, parts[0].sigma, np.concatenate([p.group for p in parts]))


def _one_blank(
    truth: Truth,
    laboratory: Laboratory,
    cuts: StraightCuts,
    settings: Mapping[str, Any],
    bias: Float,
    rng: np.random.Generator,
    progress: Progress,
) -> Measured:
    controller, cutter = _controller(settings), _cutter(settings)
    tool = int(settings.get("tool", 1))
    path, row_of = slot_path(cuts, tool)
    points = settings.get("datum_points_m")
    record = simulate(
        path,
        truth=truth,
        controller=controller,
        stock=_stock(settings),
        cutter=cutter,
        datum_points_part=None if points is None else as_float("datum_points_m", points, (None, 3)),
        progress=progress,
    )
    if len(record.time_s) == 0:
        raise InputError("the test cuts never come near the blank", hint="Check start, end and blank of the request")
    force = _reading(truth, laboratory, record, controller, bias, rng)
    low, high = _box(settings)
    gauge = DEPTH_GAUGE_M * rng.standard_normal((len(cuts), 2)) if settings.get("measure_depth", False) else None
    columns = _SlotColumns(record, cuts, row_of[record.row], force, low, high, cutter.radius_m, gauge)
    return columns.measured(tool, float(settings.get("rate_hz", RATE_HZ)), laboratory.force_n, controller.cycle_s)


def _reading(
    truth: Truth, laboratory: Laboratory, record: Record, controller: Controller, bias: Float, rng: np.random.Generator
) -> Float:
    """(n, 3) N: what the sensor shows, turned into base axes by the controller."""
    names = [body.name for body in truth.bodies]
    carried = truth.bodies[names.index(_SENSOR) + 1 :] if _SENSOR in names else truth.bodies[-1:]
    mass = sum(body.mass_kg for body in carried)
    R_base_part = record.T_base_part[:3, :3]
    n = len(record.time_s)
    dt = controller.cycle_s
    acceleration = np.zeros((n, 3))
    if n > 2:
        acceleration[1:-1] = np.diff(record.p_part_tcp, n=2, axis=0) / dt**2
        jump = np.diff(record.time_s) > 1.5 * dt
        acceleration[1:][jump] = 0.0
        acceleration[:-1][jump] = 0.0
    acting = record.force_part @ R_base_part.T + mass * (truth.gravity_base - acceleration @ R_base_part.T)
    axes = controller.tool_poses(record.p_part_command, np.tile(np.array([0.0, 0.0, 1.0]), (n, 1)))[:, :3, :3]
    R_base_stated = controller.T_base_part[:3, :3] @ axes
    R_base_true = R_base_part @ rotation.exp(record.tilt_part) @ axes
    shown = np.einsum("nji,nj->ni", R_base_true, acting)
    share = (record.time_s - record.time_s[0]) / max(float(record.time_s[-1] - record.time_s[0]), 1e-9)
    drift = np.outer(share, DRIFT_N * rng.standard_normal(3))
    shown += bias + drift + laboratory.force_n * rng.standard_normal((n, 3))
    out: Float = np.einsum("nij,nj->ni", R_base_stated, shown)
    return out


@dataclass(frozen=True, eq=False)
class _SlotColumns:
    """The record of a run, by test cut."""

    record: Record
    cuts: StraightCuts
    row: Int
    force: Float
    low: Float
    high: Float
    radius: float
    gauge: Float | None

    def measured(self, tool: int, rate_hz: float, force_n: float, cycle_s: float) -> Measured:
        """Means over the sampling time, grouped by cut, with some air before and after."""
        record, cuts = self.record, self.cuts
        touching = engaged(record.p_part_command, self.low, self.high, self.radius) & (self.row >= 0)
        every = max(1, round(1.0 / (rate_hz * cycle_s)))
        channels: dict[str, list[Float]] = {}
        group: list[Int] = []
        for number in np.unique(cuts.cut):
            rows = self._of_cut(int(number), touching)
            count = len(rows) // every
            if count < 2:
                continue
            blocks = rows[: count * every].reshape(count, every)
            place = np.clip(self.row[blocks[:, 0]], 0, None)
            depth = np.where(touching[blocks], self.high[2] - record.p_part_command[blocks][..., 2], 0.0)
            depth = np.where(np.all(touching[blocks], axis=1), depth.mean(axis=1), 0.0)
            new = {
                "time_s": record.time_s[blocks].mean(axis=1),
                "f_tcp_base": self.force[blocks].mean(axis=1),
                "q": record.q_motor[blocks].mean(axis=1),
                "feed_direction": cuts.direction[place],
                "feed_rate": cuts.feed_m_s[place],
                "spindle_speed": cuts.spindle_rad_s[place],
                "depth": depth,
                "width": cuts.width_m[place],
                "tool": np.full(count, float(tool)),
                "blank": cuts.blank[place].astype(np.float64),
            }
            if self.gauge is not None:
                new["depth_measured"] = record.depth_m[blocks].mean(axis=1) + self._gauged(blocks, place)
            for name, values in new.items():
                channels.setdefault(name, []).append(values)
            group.append(np.full(count, number, dtype=np.int64))
        if not group:
            raise InputError("the test cuts are too short to be recorded", value=f"{rate_hz:g} Hz")
        sigma: dict[str, float | Float] = {"f_tcp_base": force_n / float(np.sqrt(every)), "q": 1e-6}
        if self.gauge is not None:
            sigma["depth_measured"] = DEPTH_GAUGE_M
        joined = {name: np.concatenate(parts) for name, parts in channels.items()}
        return Measured(joined, sigma, np.concatenate(group))

    def _gauged(self, blocks: Int, place: Int) -> Float:
        """Error of the depth gauge, read at both ends of every motion and drawn straight between."""
        if self.gauge is None:
            return np.zeros(len(place))
        begin, end = self.cuts.start_part[place], self.cuts.end_part[place]
        travel = np.linalg.norm(self.record.p_part_command[blocks[:, 0]] - begin, axis=1)
        share = np.clip(travel / np.linalg.norm(end - begin, axis=1), 0.0, 1.0)
        out: Float = (1.0 - share) * self.gauge[place, 0] + share * self.gauge[place, 1]
        return out

    def _of_cut(self, number: int, touching: Bool) -> Int:
        """Rows of a cut, from a second of feed motion before the first touch to one after the last."""
        mine = np.flatnonzero(touching & (self.cuts.cut[np.maximum(self.row, 0)] == number))
        if len(mine) == 0:
            return np.zeros(0, dtype=np.int64)
        time = self.record.time_s
        begin, end = float(time[mine[0]]) - _AIR_S, float(time[mine[-1]]) + _AIR_S
        feeding = (self.row >= 0) & (self.cuts.cut[np.maximum(self.row, 0)] == number)
        starts = np.flatnonzero(np.diff(time, prepend=-np.inf) > 1.5 * float(np.min(np.diff(time))))
        begun = time[starts[np.searchsorted(starts, np.arange(len(time)), side="right") - 1]]
        out: Int = np.flatnonzero((time >= begin) & (time <= end) & feeding & (time - begun >= _CALM_S))
        return out


def _setting(settings: Mapping[str, Any], name: str) -> Any:
    if name not in settings:
        raise InputError("the settings of the test cuts lack a value", value=name)
    return settings[name]


def _numbers(settings: Mapping[str, Any], name: str, *shape: int) -> Float:
    return as_float(name, _setting(settings, name), shape)


def _controller(settings: Mapping[str, Any]) -> Controller:
    get = partial(_numbers, settings)
    a1, a2, b, c1, c2, c3, c4 = get("opw_m", 7).tolist()
    offsets = tuple(get("opw_offsets_rad", 6).tolist())
    signs = tuple(int(s) for s in get("opw_signs", 6).tolist())
    return Controller(
        opw=Opw(a1, a2, b, c1, c2, c3, c4, offsets, signs),
        joint_limits_rad=get("joint_limits_rad", 6, 2),
        T_flange_tcp=get("T_flange_tcp", 4, 4),
        T_base_part=get("T_base_part", 4, 4),
        branch=str(_setting(settings, "branch")),
        rotation_about_tool_rad=float(_setting(settings, "rotation_about_tool_rad")),
    )


def _cutter(settings: Mapping[str, Any]) -> Cutter:
    return Cutter(
        diameter_m=float(_setting(settings, "cutter_diameter_m")),
        corner_radius_m=float(settings.get("cutter_corner_radius_m", 0.0)),
        flutes=int(_setting(settings, "cutter_flutes")),
        flute_length_m=float(_setting(settings, "cutter_flute_length_m")),
    )


def _box(settings: Mapping[str, Any]) -> tuple[Float, Float]:
    low, high = (_numbers(settings, name, 3) for name in ("blank_low_m", "blank_high_m"))
    return low, high


def _stock(settings: Mapping[str, Any]) -> HeightMap:
    (x0, y0, z0), (x1, y1, z1) = (corner.tolist() for corner in _box(settings))
    return HeightMap.from_box((x0, y0, z0), (x1, y1, z1), float(_setting(settings, "blank_cell_m")))
