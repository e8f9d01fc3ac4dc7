"""Machine a program on the simulated cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, silent
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import pose
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.twin.plant.controller import CommandedReference, Controller, as_it_is
from counterflex.twin.plant.drives import first_order_lag, following_gains
from counterflex.twin.plant.plant import STEP_S, Plant
from counterflex.twin.plant.process import StockCutting, as_ground
from counterflex.twin.plant.record import Record, SimulatedCycles
from counterflex.twin.plant.turning.column_material import near as near_columns
from counterflex.twin.plant.turning.process import TurningProcess
from counterflex.twin.truth.truth import Truth


def tip_in_part(plant: Plant, process: StockCutting, T_base_tcp: Float | None) -> Float:
    """(3,) m, tip of the tool in the part frame.

    ``plant``: The robot; its hand holds the tool, or the part. ``T_base_tcp``: (4, 4) tool frame of a spindle that
    stands, where the robot holds the part; else None.
    """
    if T_base_tcp is None:
        T = process.T_base_part
        out: Float = (plant.p_base_tcp - T[:3, 3]) @ T[:3, :3]
        return out
    held: Float = (T_base_tcp[:3, 3] - plant.p_base_tcp) @ plant.R_base_tcp
    return held


def load_on_hand(plant: Plant, process: StockCutting, T_base_tcp: Float | None) -> Float:
    """(6,) N, N m, what the process does to the robot, about the origin of its hand, base axes.

    Args:
        plant: See :func:`tip_in_part`.
        process: Likewise; where the robot holds the part, it is told where that is now.
    """
    if T_base_tcp is None:
        return process.wrench(plant.p_base_tcp)
    process.T_base_part[:3, :3], process.T_base_part[:3, 3] = plant.R_base_tcp, plant.p_base_tcp
    on_tool = process.wrench(T_base_tcp[:3, 3].copy())
    return -pose.shift_wrench(on_tool, T_base_tcp[:3, 3] - plant.p_base_tcp)


# Where the part really lies once its frame has been measured with the robot itself.
# In the shop the part is clamped somewhere and the robot touches datum points on it. The controller computes their
# coordinates from its nominal geometry; the tool really is where sag and geometric error put it. So the part's true
# pose is the one that carries the datum points onto the touched ones: what the robot gets wrong there cancels, only its
# variation across the part remains.


def touched_part_frame(plant: Plant, controller: Controller, datum_points_part: Float) -> tuple[Float, Float]:
    """Touch datum points in static equilibrium, no load but the robot's own weight.

    ``controller``: What it believes, with the part frame it will run the program in. ``datum_points_part``: (k, 3) m, k
    >= 3, not on one line, in the part frame.

    Returns:
        ``T_base_part`` (4, 4) true pose of the part, and what the rigid fit leaves at the points (k, 3) m in base axes.

    Raises:
        InputError: Too few points, or points on one line.
        ReachError: The robot cannot reach one.
    """
    points = as_float("datum_points_part", datum_points_part, (None, 3))
    if len(points) < 3:
        raise InputError("datum points", value=len(points), limit="3 or more")
    axis = np.tile(np.array([0.0, 0.0, 1.0]), (len(points), 1))
    touched = np.array([plant.equilibrium(q)[:3, 3] for q in controller.joints(points, axis)])
    return pose.register(touched, points)


LEAD_IN_S = 0.4  # motion through air that is simulated before contact becomes possible
LEAD_OUT_S = 0.1  # and after
CLEARANCE_M = 8.0e-3  # commanded tips closer than this to the stock's box may touch it
_REPORT_EVERY = 250


def simulate(
    path: ToolPath,
    *,
    truth: Truth,
    controller: Controller,
    stock: HeightMap,
    cutter: Cutter | Mapping[int, Cutter],
    datum_points_part: Float | None = None,
    turning: bool = False,
    skip_air: bool = True,
    step_s: float = STEP_S,
    progress: Progress = silent,
) -> Record:
    """Machine a tool path: drives, elastic robot and cutting process, coupled at every step.

    The robot starts each stretch in exact static equilibrium with the motors at the commanded speed. With
    ``skip_air``, stretches in which the commanded tool stays ``CLEARANCE_M`` clear of the stock's box are left out but
    for the last 0.4 s before and the first 0.1 s after contact is possible; friction has slid into the direction of
    motion and the start transient has died out by then.

    Args:
        path: In the part frame.
        truth: The cell as it really is.
        controller: What the robot controller believes.
        stock: Blank in the part frame; not changed.
        cutter: The tool, or the tools by their numbers: a tool change mounts the next one, in the same stock.
        datum_points_part: (k, 3) m; the part frame is measured by touching them with the robot (see
            :func:`touched_part_frame`). None: it was measured with an ideal instrument, the part lies exactly where
            the controller has it.
        turning: The tool cuts in several directions or turns while it cuts: the material is held in columns, and the
            record has what is left of them.
        skip_air: Leave out long air moves.
        step_s: Integration step, s; divides the controller's cycle.
        progress: Progress callback, fraction 0 to 1; may raise ``Interrupted``.

    Raises:
        InputError: The path feeds with several tools and one is given, or the step does not divide the cycle.
        ReachError: The robot cannot reach the path.
        SimulationError: The robot becomes unstable, the tool cuts with its shank or with the spindle off.
    """
    fed = np.unique(path.tool[path.kind == FEED]).tolist()
    if len(fed) > 1 and isinstance(cutter, Cutter):
        raise InputError("the path cuts with several tools and one is given", value=fed, hint="Give them by number")
    mounted = mounted_tools(path)
    substeps = round(controller.cycle_s / step_s)
    if substeps < 1 or abs(substeps * step_s - controller.cycle_s) > 1e-9:
        raise InputError("integration step does not divide the controller's cycle", value=step_s)
    running = as_it_is(controller, truth.other.controller)
    reference = _as_driven(CommandedReference.interpolated(path, running), truth, controller.cycle_s)
    plant = Plant(truth, step_s=step_s)
    T_base_part, residual = as_float("T_base_part", controller.T_base_part, (4, 4)), np.zeros((0, 3))
    if datum_points_part is not None:
        T_base_part, residual = touched_part_frame(plant, controller, datum_points_part)
    blank = as_delivered(stock, truth.stock_top_offset_m)
    cutters = {
        number: as_ground(cutter if isinstance(cutter, Cutter) else cutter[number], truth.other.tool(number))
        for number in np.unique(mounted).tolist()
    }
    tool = mounted[reference.source]
    mount, widest = cutters[int(tool[0])], max(c.radius_m for c in cutters.values())
    if turning:
        longest = max(min(c.flute_length_m, 1.0) for c in cutters.values())
        process: StockCutting = TurningProcess(blank, mount, truth.cutting, step_s, T_base_part, plant.R_base_tcp)
        near = near_columns(reference.p_part_command, reference.axis_part, blank, widest, longest, CLEARANCE_M)
    else:
        process = StockCutting(blank, mount, truth.cutting, step_s, T_base_part)
        near = near_stock(reference.p_part_command, blank, widest)
    fixed = controller.T_base_tcp
    run = _SimulatedRun(plant, process, reference, path.spindle_rad_s[reference.source], near, substeps)
    run.tool, run.cutters, run.T_base_tcp = tool, cutters, fixed
    stretches = _stretches(near, controller.cycle_s, skip_air)
    parts = in_parts(progress, {str(first): float(last - first) for first, last in stretches} or {"": 1.0})
    for first, last in stretches:
        run.stretch(first, last, parts[str(first)])
    Rs_part_command = controller.tool_poses(reference.p_part_command, reference.axis_part, reference.turned_rad)[
        :, :3, :3
    ]
    progress(1.0, "machined")
    left = process.finish_material() if isinstance(process, TurningProcess) else process.finish()
    commanded = Rs_part_command[run.rows]
    return run.cycles().record(path, reference, commanded, left, T_base_part, residual, T_base_tcp=fixed)


def mounted_tools(path: ToolPath) -> Int:
    """(n,) number of the tool that each row is simulated with: its own, where it is one that cuts.

    Before the first change, and with an empty spindle, it is the next one that cuts; behind the last cut the last one.
    """
    rows = np.flatnonzero(path.kind == FEED)
    if len(rows) == 0:
        return np.full(len(path), path.tool[-1], dtype=np.int64)
    following = rows[np.minimum(np.searchsorted(rows, np.arange(len(path))), len(rows) - 1)]
    out: Int = np.where(np.isin(path.tool, path.tool[rows]), path.tool, path.tool[following])
    return out


def _as_driven(reference: CommandedReference, truth: Truth, cycle_s: float) -> CommandedReference:
    """References behind the lag of drives without speed feed-forward."""
    gains = following_gains(truth.drives)
    trailing = np.flatnonzero(np.isfinite(gains))
    if len(trailing) == 0:
        return reference
    q = reference.q_ref.copy()
    for axis in trailing:
        q[:, axis : axis + 1] = first_order_lag(q[:, axis : axis + 1], cycle_s, float(gains[axis]))
    return replace(reference, q_ref=q, qd_ref=np.gradient(q, cycle_s, axis=0))


def as_delivered(stock: HeightMap, offset_m: float) -> HeightMap:
    """The blank with its top where it really is; columns without material stay so."""
    blank = stock.copy()
    solid = blank.z > blank.bottom_m
    blank.z[solid] = np.maximum(blank.z[solid] + np.float32(offset_m), np.float32(blank.bottom_m))
    blank.refresh()
    return blank


def near_stock(p_part: Float, stock: HeightMap, radius_m: float) -> Bool:
    """Samples whose tool may touch the stock's box."""
    ny, nx = stock.z.shape
    low = np.array([stock.x0_m, stock.y0_m]) - radius_m - CLEARANCE_M
    high = np.array([stock.x0_m + (nx - 1) * stock.cell_m, stock.y0_m + (ny - 1) * stock.cell_m])
    inside = np.all((p_part[:, :2] > low) & (p_part[:, :2] < high + radius_m + CLEARANCE_M), axis=1)
    return np.array(inside & (p_part[:, 2] < float(stock.z.max()) + CLEARANCE_M))


def _stretches(near: Bool, cycle_s: float, skip_air: bool) -> list[tuple[int, int]]:
    """First and last sample of each stretch to simulate."""
    n = len(near)
    if not skip_air:
        return [(0, n - 1)]
    simulated = np.zeros(n, dtype=bool)
    lead_in, lead_out = round(LEAD_IN_S / cycle_s), round(LEAD_OUT_S / cycle_s)
    change = np.diff(np.concatenate([[False], near, [False]]).astype(np.int8))
    for k, end in zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1), strict=True):
        simulated[max(0, k - lead_in) : min(n, end + lead_out)] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[False], simulated, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - 1 > a]


def hermite(substeps: int, cycle_s: float) -> tuple[Float, Float]:
    """Weights (substeps, 4) of q0, qd0, q1, qd1 for position and speed within a cycle."""
    u = np.arange(substeps) / substeps
    place = np.stack(
        [(1 + 2 * u) * (1 - u) ** 2, cycle_s * u * (1 - u) ** 2, u**2 * (3 - 2 * u), cycle_s * u**2 * (u - 1)], axis=1
    )
    speed = np.stack(
        [6 * u * (u - 1) / cycle_s, (1 - u) * (1 - 3 * u), 6 * u * (1 - u) / cycle_s, u * (3 * u - 2)], axis=1
    )
    return place, speed


class _SimulatedRun:
    """The time loop and what it records."""

    def __init__(
        self,
        plant: Plant,
        process: StockCutting,
        reference: CommandedReference,
        spindle: Float,
        near: Bool,
        substeps: int,
    ) -> None:
        n = len(reference.time_s)
        self.plant, self.process, self.reference = plant, process, reference
        self.spindle, self.near, self.substeps = spindle, near, substeps
        self.tool: Int = np.zeros(n, dtype=np.int64)
        self.cutters: Mapping[int, Cutter] = {}
        self.T_base_tcp: Float | None = None
        self._mounted: int | None = None
        self.place, self.speed = hermite(substeps, float(reference.time_s[1]))
        self.p_base_tcp: Float = np.zeros((n, 3))
        self.R_base_tcp: Float = np.zeros((n, 3, 3))
        self.q_motor: Float = np.zeros((n, 6))
        self.sums: Float = np.zeros((n, 9))
        self.done: Bool = np.zeros(n, dtype=bool)

    @property
    def rows(self) -> Int:
        return np.flatnonzero(self.done)

    def cycles(self) -> SimulatedCycles:
        k, reference = self.rows, self.reference
        motion = self.p_base_tcp[k], self.R_base_tcp[k], reference.q_ref[k], self.q_motor[k]
        return SimulatedCycles(k, reference.time_s[k], *motion, self.sums[k])

    def stretch(self, first: int, last: int, progress: Progress) -> None:
        plant, process, reference = self.plant, self.process, self.reference
        plant.program_time(float(reference.time_s[first]), int(self.tool[first]))
        plant.reset(reference.q_ref[first], None, reference.qd_ref[first])
        turning, was_near = np.nan, False
        free: Float = np.zeros(6)
        knots: Float = np.empty((4, 6))
        for k in range(first, last + 1):
            self.p_base_tcp[k] = plant.p_base_tcp
            self.R_base_tcp[k] = plant.R_base_tcp
            self.q_motor[k] = plant.q_motor()
            self.done[k] = True
            if k == last:
                break
            if (k - first) % _REPORT_EVERY == 0:
                progress((k - first) / (last - first), "machining on the twin")
            if self.tool[k] != self._mounted:
                self._mounted, was_near, turning = int(self.tool[k]), False, np.nan
                process.mount(self.cutters[self._mounted])
            near = bool(self.near[k])
            if near:
                if not was_near:
                    process.restart(tip_in_part(plant, process, self.T_base_tcp))
                if self.spindle[k] != turning:
                    turning = self.spindle[k]
                    process.spindle(float(turning))
                process.advance(tip_in_part(plant, process, self.T_base_tcp))
            was_near = near
            process.clear()
            knots[0], knots[1] = reference.q_ref[k], reference.qd_ref[k]
            knots[2], knots[3] = reference.q_ref[k + 1], reference.qd_ref[k + 1]
            q, qd = self.place @ knots, self.speed @ knots
            for i in range(self.substeps):
                plant.step(q[i], qd[i], load_on_hand(plant, process, self.T_base_tcp) if near else free)
            self.sums[k] = process.sums
            plant.check()
