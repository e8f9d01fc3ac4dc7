"""Kernel: walk along a path, cut the stock step by step, and let the force bend the tool away, causally in time.

At each step the tool is where the command and the displacement of the last step put it; the segment it sweeps is cut,
what was removed gives the engagement, the engagement gives the force, and the force drives one structural mode,

    x'' + 2 zeta w x' + w^2 x = w^2 C F,

advanced exactly over the step with the force held (closed form of the damped oscillator), but for the thrust of an end
face that descends, which is solved for (:mod:`counterflex.plan.bending_kernels`). A whole-path fixed point of force and
displacement diverges at entries and exits; this order in time does not.
"""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.cutting.kernel_arrays import GRID, StockGrid
from counterflex.cutting.mean_force import mean_wrench
from counterflex.cutting.stock import BLOCK_COLUMNS, BLOCK_ROWS
from counterflex.cutting.sweep_kernels import stamp_segment
from counterflex.path.toolpath import FEED
from counterflex.plan.bending_kernels import (
    AMPLITUDE,
    FORCE,
    PROGRAMMED,
    UP,
    bend_at_rest,
    bend_through_mode,
    follow_descent,
)
from counterflex.plan.cut_kernel_arrays import CUT_PATH, CUT_ROWS, CUT_TOOL, STATE, CutPath, CutRows, CutTool
from counterflex.plan.elastic_motion_kernel import MOTION, MotionArrays, advance, rest

AIR_STEP = 0.25
"""Longest step of a tool that may meet material, over omega (1/25 of the mode's period)."""
LONGEST_STEP = 1.0
"""Longest step in the cut, over omega, where the force is so light that it cannot excite the mode."""
SHORTEST_STEP = 0.04
"""Shortest step, over omega."""
GAIN = 0.2
"""Bound on how much of a step's displacement the force of the next step may answer. The direction of the chip follows
the tool's own velocity, so a displacement rate u turns the force by u / v; over a step that displaces the tool by
``(F C / v) u (omega dt)^2 / (2 dt)`` more, and force and displacement chase each other when that gain nears one."""

MOVING = 0.25
"""Share of these steps that the whole robot in motion allows: its tool side answers faster than its lowest mode."""

_ANGLES = 24
_RINGS = 6
_TWO_PI = 2.0 * math.pi
_THRESHOLD = 0.02  # of the largest bin: below it a bin counts as grazed by grid noise, not as engaged


@kernel(
    "void(int64, int64, Path, Tool, Grid, float64, float64, Motion, State[::1], Rows)",
    Path=CUT_PATH,
    Tool=CUT_TOOL,
    Grid=GRID,
    Motion=MOTION,
    State=STATE,
    Rows=CUT_ROWS,
    entry=True,
)
def cut_rows(
    first: int,
    last: int,
    path: CutPath,
    tool: CutTool,
    grid: StockGrid,
    omega: float,
    zeta: float,
    motion: MotionArrays,
    states: Records,
    rows: CutRows,
) -> None:
    """Cut rows [first, last) of a path.

    Args:
        first: Row, >= 1.
        last: Row behind the last.
        path: See :class:`CutPath`.
        tool: See :class:`CutTool`.
        grid: Of the stock, cut in place.
        omega: Undamped angular frequency of the mode, rad/s; 0 cuts the undisturbed path: the displacement stays zero.
        zeta: Its damping ratio.
        motion: The elastic robot in motion, which then bends the tool, or
            :data:`counterflex.plan.elastic_motion.STILL`.
        states: (1,) of :data:`STATE`, changed.
        rows: Results, written.
    """
    p_command, kind, time, spindle = path.p_command, path.kind, path.time_s, path.spindle_rad_s
    compliance, offset = path.compliance, path.offset
    flutes, shape, workspace, terms, arc = tool.flutes, tool.shape, tool.workspace, tool.terms, tool.arc
    levels, edges, depth, extra = tool.levels, tool.edges, tool.depth, tool.extra
    wrench_feed, force = tool.wrench_feed, tool.force
    wrench, displacement, volume, axial = rows.wrench, rows.displacement, rows.volume, rows.axial
    entry, exit_, feed_tooth, chip = rows.entry, rows.exit_, rows.feed_tooth, rows.chip
    s = states[0]
    coupled = omega > 0.0
    moving = motion.x.shape[0] > 0
    finer = MOVING if moving else 1.0
    if moving and motion.clock[1] == 0.0:
        rest(motion, first - 1)
    thrust, space = tool.thrust, tool.space
    thrust[UP], thrust[UP + 1], thrust[UP + 2] = 0.0, 0.0, 1.0
    flat = shape[0] - shape[1]
    for i in range(first, last):
        for k in range(6):
            wrench[i, k] = 0.0
        volume[i] = 0.0
        axial[i] = 0.0
        entry[i] = math.nan
        exit_[i] = math.nan
        feed_tooth[i] = 0.0
        chip[i] = 0.0
        rate = abs(spindle[i]) / _TWO_PI * flutes
        cutting = kind[i] == FEED
        row_time = time[i] - time[i - 1]
        left = row_time
        share = 0.0
        while share < 1.0:
            dt = left
            share = 1.0
            if coupled and cutting and row_time > 0.0:
                dt = step_length(left, row_time, omega, s.bend, p_command, i, finer)
                left -= dt
                # The last step ends with the row exactly; a share from a difference would miss it by rounding.
                if dt < left + dt:
                    share = 1.0 - left / row_time
            xa, ya, za = s.tip[0], s.tip[1], s.tip[2]
            xb = p_command[i - 1, 0] + share * (p_command[i, 0] - p_command[i - 1, 0]) + s.displacement[0]
            yb = p_command[i - 1, 1] + share * (p_command[i, 1] - p_command[i - 1, 1]) + s.displacement[1]
            zb = p_command[i - 1, 2] + share * (p_command[i, 2] - p_command[i - 1, 2]) + s.displacement[2]
            plane = math.hypot(xb - xa, yb - ya)
            thrust[AMPLITUDE], thrust[FORCE] = 0.0, 0.0
            if row_time > 0.0:
                thrust[PROGRAMMED] = (p_command[i - 1, 2] - p_command[i, 2]) / row_time
            for k in range(6):
                force[k] = 0.0
            if plane > 0.0 or za != zb:
                lean_x, lean_y = 0.0, 0.0
                if cutting and za > zb and flat > 0.0:
                    lean_x, lean_y = _end_face_lean(grid, xb, yb, zb, za - zb, flat)
                # Asked before the stamp lowers the map.
                room = _room(grid, xa, ya, xb, yb, shape[0]) - min(za, zb) if cutting else 0.0
                removed = stamp_segment(grid, shape, xa, ya, za, xb, yb, zb, s.stamped != 0, workspace, depth, extra)
                volume[i] += removed
                s.stamped = 1
                if removed > 0.0 and cutting and dt > 0.0 and rate > 0.0:
                    teeth = rate * dt
                    end_area = extra[0] / (za - zb) if za > zb else 0.0
                    mean_wrench(depth, plane / teeth, (za - zb) / teeth, end_area, terms, arc, levels, wrench_feed)
                    ux, uy = (1.0, 0.0) if plane == 0.0 else ((xb - xa) / plane, (yb - ya) / plane)
                    for k in (0, 3):
                        force[k] = ux * wrench_feed[k] - uy * wrench_feed[k + 1]
                        force[k + 1] = uy * wrench_feed[k] + ux * wrench_feed[k + 1]
                        force[k + 2] = wrench_feed[k + 2]
                    for t in range(terms.shape[0] if za > zb else 0):
                        push = terms[t, 1] * ((za - zb) / teeth) ** terms[t, 0]
                        force[0] -= push * lean_y
                        force[1] += push * lean_x
                    if za > zb and force[2] > 0.0:
                        drop = za - zb
                        follow_descent(
                            depth, plane / teeth, drop / teeth, end_area, terms, arc, levels, force[2], drop / dt,
                            thrust, space,
                        )  # fmt: skip
                    feed_tooth[i] = math.hypot(plane, zb - za) / teeth
                    deepest, low, high, mean_sine = engaged(depth, edges, shape[0], grid.cell)
                    axial[i] = max(axial[i], min(deepest, room))
                    if deepest > 0.0:
                        entry[i], exit_[i] = low, high
                    side = feed_tooth[i] * mean_sine * (removed - extra[0])
                    chip[i] = (side + max(0.0, (za - zb) / teeth) * extra[0]) / removed
            s.tip[0], s.tip[1], s.tip[2] = xb, yb, zb
            if row_time > 0.0:
                for k in range(6):
                    wrench[i, k] += force[k] * (dt / row_time)
            if moving and dt > 0.0:
                # A chip is as thick as the tool has moved since the last tooth: the mean velocity over a tooth period,
                # half a period late. A lag of a whole one would feed the arm's swing: the model would chatter.
                fresh = 1.0 - math.exp(-2.0 * dt * rate) if rate > 0.0 else 1.0
                for k in range(6):
                    along = thrust[UP + k] * thrust[FORCE] if k < 3 else 0.0
                    s.force[k] += fresh * (force[k] - along - s.force[k])
                    motion.thrust[k] = thrust[k]
                advance(motion, i, time[i] - left if share < 1.0 else time[i], s.force[:], s.displacement[:])
                bend = bend_at_rest(compliance, i, force)
                # The step stays short for a while after the force has gone: the mode still swings.
                s.bend = max(bend, s.bend * math.exp(-omega * dt))
            elif coupled and dt > 0.0:
                bend = bend_through_mode(
                    s.displacement[:], s.rate[:], compliance, offset, i, share, force, thrust, dt, omega, zeta
                )
                s.bend = max(bend, s.bend * math.exp(-omega * dt))
        for k in range(6):
            displacement[i, k] = s.displacement[k]


@kernel("float64(Grid, float64, float64, float64, float64, float64)", Grid=GRID)
def _room(grid: StockGrid, xa: float, ya: float, xb: float, yb: float, radius: float) -> float:
    """Height of the material, from its block maxima, over the rectangle that a tool sweeps: no cut reaches above it."""
    rows, columns = grid.tops.shape
    tall, wide = BLOCK_ROWS * grid.cell, BLOCK_COLUMNS * grid.cell
    first_row = max(0, math.floor((min(ya, yb) - radius - grid.y0) / tall))
    last_row = min(rows - 1, math.floor((max(ya, yb) + radius - grid.y0) / tall))
    first = min(columns - 1, max(0, math.floor((min(xa, xb) - radius - grid.x0) / wide)))
    last = min(columns - 1, max(0, math.floor((max(xa, xb) + radius - grid.x0) / wide + 1.0)))
    highest = grid.floor
    for j in range(first_row, last_row + 1):
        for i in range(first, last + 1):
            highest = max(highest, grid.tops[j, i])
    return highest


@kernel("UniTuple(float64, 2)(Grid, float64, float64, float64, float64, float64)", Grid=GRID)
def _end_face_lean(grid: StockGrid, x: float, y: float, z: float, drop: float, radius: float) -> tuple[float, float]:
    """``integral of r_hat d_rho d_phi`` over the part of a descending end face that stands on material, m."""
    # Zero where all of the face is engaged; where only part of it is (a ramp that runs out of the part), the cutting
    # forces of the end edges no longer cancel and push the tool along `z x` this vector.
    sum_x, sum_y = 0.0, 0.0
    ny, nx = grid.z.shape
    for a in range(_ANGLES):
        angle = _TWO_PI * (a + 0.5) / _ANGLES
        c, s = math.cos(angle), math.sin(angle)
        for r in range(_RINGS):
            rho = radius * (r + 0.5) / _RINGS
            i = round((x + rho * c - grid.x0) / grid.cell)
            j = round((y + rho * s - grid.y0) / grid.cell)
            if 0 <= i < nx and 0 <= j < ny and grid.z[j, i] > z + 0.5 * drop and z >= grid.floor:
                sum_x += c
                sum_y += s
    area = radius / _RINGS * _TWO_PI / _ANGLES
    return sum_x * area, sum_y * area


@kernel("float64(float64, float64, float64, float64, float64[:, ::1], int64, float64)")
def step_length(
    left: float, row_time: float, omega: float, bend: float, p_command: Float, i: int, finer: float
) -> float:
    """Length of the next step within a row of a bending tool, s, see :data:`GAIN`."""
    limit = AIR_STEP / omega
    if bend > 0.0:
        dx = p_command[i, 0] - p_command[i - 1, 0]
        dy = p_command[i, 1] - p_command[i - 1, 1]
        dz = p_command[i, 2] - p_command[i - 1, 2]
        speed = math.sqrt(dx * dx + dy * dy + dz * dz) / row_time
        limit = 2.0 * finer * GAIN * speed / (bend * omega * omega)
        limit = min(max(limit, finer * SHORTEST_STEP / omega), LONGEST_STEP / omega)
    return left / max(1, math.ceil(left / limit))


@kernel("UniTuple(float64, 4)(float64[:, ::1], float64[::1], float64, float64)")
def engaged(depth: Float, edges: Float, radius: float, cell: float) -> tuple[float, float, float, float]:
    """Largest axial depth, first and last engaged angle, and the mean of sin(phi) over the engaged edge.

    A bin near 0 or 180 deg is narrower than a cell of the stock, so its depth is noise: the largest depth is that of
    the mean over neighbouring engaged bins, together as wide as two cells and an eighth of the radius.
    """
    bins = depth.shape[1]
    highest = 0.0
    total = 0.0
    sine = 0.0
    for b in range(bins):
        column = 0.0
        for level in range(depth.shape[0]):
            column += depth[level, b]
        highest = max(highest, column)
        if column > 0.0:  # most bins are out of the cut
            total += column
            sine += column * math.sin(0.5 * (edges[b] + edges[b + 1]))
    if total <= 0.0:
        return 0.0, math.nan, math.nan, 0.0
    length = max(2.0 * cell, 0.125 * radius)
    first, last = bins, -1
    deepest, area, width = 0.0, 0.0, 0.0
    for b in range(bins):
        column = 0.0
        for level in range(depth.shape[0]):
            column += depth[level, b]
        if column <= _THRESHOLD * highest:
            area, width = 0.0, 0.0
            continue
        first = min(first, b)
        last = b
        strip = radius * (math.cos(edges[b]) - math.cos(edges[b + 1]))
        area += column * strip
        width += strip
        if width >= length:
            deepest = max(deepest, area / width)
            area, width = 0.0, 0.0
    # No strip is as wide as two cells: the mean is what is left.
    if deepest == 0.0:
        deepest = _mean_depth(depth, edges)
    return deepest, float(edges[first]), float(edges[last + 1]), sine / total


@kernel("float64(float64[:, ::1], float64[::1])")
def _mean_depth(depth: Float, edges: Float) -> float:
    """Mean axial depth over the engaged width."""
    area, width = 0.0, 0.0
    for b in range(depth.shape[1]):
        column = 0.0
        for level in range(depth.shape[0]):
            column += depth[level, b]
        if column > 0.0:
            strip = math.cos(edges[b]) - math.cos(edges[b + 1])
            area += column * strip
            width += strip
    return area / width if width > 0.0 else 0.0
