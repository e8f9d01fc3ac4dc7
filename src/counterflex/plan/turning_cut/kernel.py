"""Kernel: :func:`counterflex.plan.cut_kernel.cut_rows` for a tool whose axis turns, in columns of material.

The tool axis goes from row to row along the chord, as the program has it; the elastic tilt of some mrad is left out of
the cut, as it is of upright cuts. The feed of the chip is the way of the point of the axis in the middle of what was
engaged last, at height c above the tip,

    d = b - a + c (u_b - u_a),   square to the axis in the middle of the step;

force and moment are turned from the feed frame (x along the feed, y to its left, z along the axis) into part axes.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from counterflex.core.arrays import Float, Float1, Float2, Float3
from counterflex.core.jit import bundle, kernel
from counterflex.core.records import Records, record
from counterflex.cutting.mean_force import mean_wrench
from counterflex.cutting.tridexel.step_kernels import STEP_COLUMNS, StepColumns, StepSpace, cut_step
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
from counterflex.plan.cut_kernel import MOVING, engaged, step_length
from counterflex.plan.cut_kernel_arrays import CUT_PATH, CUT_ROWS, CutPath, CutRows
from counterflex.plan.elastic_motion_kernel import MOTION, MotionArrays, advance, rest

TURNING_STATE: Final = record(
    displacement=(float, 6),
    rate=(float, 6),
    tip=(float, 3),
    bend=float,
    force=(float, 6),
    height=float,
    full=int,
)
"""As :data:`counterflex.plan.cut_kernel_arrays.STATE`, with the height on the cutter at the middle of what it cut last
(m above the tip), and the row to go on with after the stock was given room; negative: the row that found none."""


class TurningTool(NamedTuple):
    """Tool of a cut: cutter and weights of its mean force, and working space for them."""

    flutes: float
    space: StepSpace
    terms: Float2
    arc: Float3
    levels: Float2
    edges: Float1
    depth: Float2
    extra: Float1
    wrench_feed: Float1
    force: Float1
    ends: Float2
    space_wrench: Float1
    thrust: Float1


TURNING_TOOL: Final = bundle(TurningTool)


_ANGLES = 24
_RINGS = 6
_TWO_PI = 2.0 * math.pi
_ASIDE = 1e-6
"""Way square to the axis by the descent, up to which a motion is a plunge: its direction is rounding."""


@kernel(
    "void(int64, int64, Path, float64[:, ::1], Tool, Columns, float64, float64, Motion, State[::1], Rows)",
    Path=CUT_PATH,
    Tool=TURNING_TOOL,
    Columns=STEP_COLUMNS,
    Motion=MOTION,
    State=TURNING_STATE,
    Rows=CUT_ROWS,
    entry=True,
)
def cut_turning_rows(
    first: int,
    last: int,
    path: CutPath,
    axis: Float,
    tool: TurningTool,
    columns: StepColumns,
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
        path: As for upright cuts.
        axis: (n, 3) unit vectors from the tip to the spindle, part axes.
        tool: See :class:`TurningTool`.
        columns: Of the stock, cut in place.
        omega: Undamped angular frequency of the mode, rad/s; 0 cuts the undisturbed path.
        zeta: Its damping ratio.
        motion: The elastic robot in motion, or :data:`counterflex.plan.elastic_motion.STILL`.
        states: (1,) of :data:`TURNING_STATE`, changed; ``full`` other than 0 ends the work at once.
        rows: Results, written.
    """
    p_command, kind, time, compliance, offset = path.p_command, path.kind, path.time_s, path.compliance, path.offset
    depth, extra, force, thrust = tool.depth, tool.extra, tool.force, tool.thrust
    radius = tool.space.shape[0]
    s = states[0]
    coupled = omega > 0.0
    moving = motion.x.shape[0] > 0
    finer = MOVING if moving else 1.0
    if s.height == 0.0:
        s.height = radius
    if moving and motion.clock[1] == 0.0:
        rest(motion, first - 1)
    for i in range(first, last):
        # A column is full: the row is begun once the stock has been given room.
        if tool.space.work[18] != 0.0:
            s.full = i
            return
        for k in range(6):
            rows.wrench[i, k] = 0.0
        rows.volume[i], rows.axial[i], rows.feed_tooth[i], rows.chip[i] = 0.0, 0.0, 0.0, 0.0
        rows.entry[i], rows.exit_[i] = math.nan, math.nan
        rate = abs(path.spindle_rad_s[i]) / _TWO_PI * tool.flutes
        cutting = kind[i] == FEED
        row_time = time[i] - time[i - 1]
        left, share, before = row_time, 0.0, 0.0
        while share < 1.0:
            dt, before = left, share
            share = 1.0
            if coupled and cutting and row_time > 0.0:
                dt = step_length(left, row_time, omega, s.bend, p_command, i, finer)
                if moving:
                    dt = max(dt, min(left, motion.step_s))
                left -= dt
                if dt < left + dt:
                    share = 1.0 - left / row_time
            if row_time > 0.0:
                thrust[PROGRAMMED] = _descent(p_command, axis, i) / row_time
            _ends_of_step(s.tip, s.displacement, p_command, axis, i, before, share, tool.ends)
            thrust[AMPLITUDE], thrust[FORCE] = 0.0, 0.0
            for k in range(6):
                force[k] = 0.0
            if _moves(tool.ends):
                ends = tool.ends
                removed = cut_step(
                    columns, tool.space, ends[0], ends[1], ends[2], ends[3], s.height, cutting, depth, extra
                )
                if removed < 0.0:
                    s.full = -i
                    return
                rows.volume[i] += removed
                if removed > 0.0 and cutting and dt > 0.0 and rate > 0.0:
                    teeth = rate * dt
                    plane, drop = _way_of(tool.space.motion)
                    _force_of_step(columns, tool, plane, drop, teeth, dt)
                    for k in range(3):
                        thrust[UP + k] = tool.space.motion[6 + k]
                    rows.feed_tooth[i] = math.hypot(plane, drop) / teeth
                    deepest, low, high, mean_sine = engaged(depth, tool.edges, radius, columns.cell)
                    rows.axial[i] = max(rows.axial[i], deepest)
                    if deepest > 0.0:
                        rows.entry[i], rows.exit_[i] = low, high
                        s.height = 0.5 * deepest
                    side = rows.feed_tooth[i] * mean_sine * (removed - extra[0])
                    rows.chip[i] = (side + max(0.0, drop / teeth) * extra[0]) / removed
            for k in range(3):
                s.tip[k] = tool.ends[2, k]
            if row_time > 0.0:
                for k in range(6):
                    rows.wrench[i, k] += force[k] * (dt / row_time)
            if moving and dt > 0.0:
                # As in cut_rows, but with the thrust held over the step. In the twisted channel, which sinks by 1 in
                # 100, one that is solved for left 42 and 29 % in the simulated cells, as this does (42 and 29 %); in
                # coarse columns of 0.4 mm it left 31, 23 and 24 %, this 25, 22 and 23 %.
                fresh = 1.0 - math.exp(-2.0 * dt * rate) if rate > 0.0 else 1.0
                for k in range(6):
                    s.force[k] += fresh * (force[k] - s.force[k])
                advance(motion, i, time[i] - left if share < 1.0 else time[i], s.force[:], s.displacement[:])
                bend = bend_at_rest(compliance, i, force)
                s.bend = max(bend, s.bend * math.exp(-omega * dt))
            elif coupled and dt > 0.0:
                bend = bend_through_mode(
                    s.displacement[:], s.rate[:], compliance, offset, i, share, force, thrust, dt, omega, zeta
                )
                s.bend = max(bend, s.bend * math.exp(-omega * dt))
        for k in range(6):
            rows.displacement[i, k] = s.displacement[k]


@kernel()
def _ends_of_step(
    tip: Float,
    displacement: Float,
    p_command: Float,
    axis: Float,
    i: int,
    before: float,
    share: float,
    out: Float,
) -> None:
    """Write tip and axis at the start and at the end of the step of row i between two shares of it: (4, 3)."""
    for k in range(3):
        step = p_command[i, k] - p_command[i - 1, k]
        turn = axis[i, k] - axis[i - 1, k]
        out[0, k], out[1, k] = tip[k], axis[i - 1, k] + before * turn
        out[2, k], out[3, k] = p_command[i - 1, k] + share * step + displacement[k], axis[i - 1, k] + share * turn
    for end in (1, 3):
        size = math.sqrt(out[end, 0] ** 2 + out[end, 1] ** 2 + out[end, 2] ** 2)
        for k in range(3):
            out[end, k] /= size


@kernel()
def _descent(p_command: Float, axis: Float, i: int) -> float:
    """Way of the commanded tip against the tool axis in a row, m."""
    along = 0.0
    for k in range(3):
        along += 0.5 * (axis[i - 1, k] + axis[i, k]) * (p_command[i - 1, k] - p_command[i, k])
    return along


@kernel()
def _moves(ends: Float) -> bool:
    """Return whether tip or axis differ between start and end of a step."""
    change = 0.0
    for k in range(3):
        change += abs(ends[0, k] - ends[2, k]) + abs(ends[1, k] - ends[3, k])
    return change > 0.0


@kernel()
def _way_of(motion: Float) -> tuple[float, float]:
    """Length of a motion (9,) square to its axis, and its descent along it, m."""
    along, square = 0.0, 0.0
    for k in range(3):
        along += motion[3 + k] * motion[6 + k]
    for k in range(3):
        square += (motion[3 + k] - along * motion[6 + k]) ** 2
    return math.sqrt(square), -along


@kernel()
def _force_of_step(columns: StepColumns, tool: TurningTool, plane: float, drop: float, teeth: float, dt: float) -> None:
    """Write the force of a step into ``tool.force``, part axes, and how its thrust follows into ``tool.thrust``."""
    wrench, force, move = tool.wrench_feed, tool.force, tool.space.motion
    end_area = tool.extra[0] / drop if drop > 0.0 else 0.0
    mean_wrench(tool.depth, plane / teeth, drop / teeth, end_area, tool.terms, tool.arc, tool.levels, wrench)
    ux, uy, uz = move[6], move[7], move[8]
    fx, fy, fz = move[3] + drop * ux, move[4] + drop * uy, move[5] + drop * uz
    if plane > _ASIDE * drop:
        fx, fy, fz = fx / plane, fy / plane, fz / plane
    else:
        fx, fy, fz = _square_to(ux, uy, uz)
    lx, ly, lz = uy * fz - uz * fy, uz * fx - ux * fz, ux * fy - uy * fx
    flat = tool.space.shape[0] - tool.space.shape[1]
    if drop > 0.0 and flat > 0.0:
        ahead, left = _face_on_material(columns, move, tool.ends, drop, flat, fx, fy, fz, lx, ly, lz)
        for t in range(tool.terms.shape[0]):
            push = tool.terms[t, 1] * (drop / teeth) ** tool.terms[t, 0]
            wrench[0] -= push * left
            wrench[1] += push * ahead
    for k in (0, 3):
        force[k] = fx * wrench[k] + lx * wrench[k + 1] + ux * wrench[k + 2]
        force[k + 1] = fy * wrench[k] + ly * wrench[k + 1] + uy * wrench[k + 2]
        force[k + 2] = fz * wrench[k] + lz * wrench[k + 1] + uz * wrench[k + 2]
    if drop > 0.0 and wrench[2] > 0.0:
        follow_descent(
            tool.depth, plane / teeth, drop / teeth, end_area, tool.terms, tool.arc, tool.levels, wrench[2], drop / dt,
            tool.thrust, tool.space_wrench,
        )  # fmt: skip


@kernel()
def _square_to(x: float, y: float, z: float) -> tuple[float, float, float]:
    """A unit vector square to one."""
    if abs(x) < 0.9:
        size = math.sqrt(y * y + z * z)
        return 0.0, z / size, -y / size
    size = math.sqrt(x * x + z * z)
    return -z / size, 0.0, x / size


@kernel()
def _face_on_material(
    columns: StepColumns,
    move: Float,
    ends: Float,
    drop: float,
    radius: float,
    fx: float,
    fy: float,
    fz: float,
    lx: float,
    ly: float,
    lz: float,
) -> tuple[float, float]:
    """``integral of r_hat d_rho d_phi`` over the part of a descending end face that stands on material, m."""
    # Its components along the feed and to the left of it; see `_end_face_lean` of the upright cut. What the step has
    # just removed is behind the face, so points half a step further down are asked for.
    sum_f, sum_l = 0.0, 0.0
    ny, nx = columns.held.shape
    x0, y0, z0 = ends[2, 0] - 0.5 * drop * move[6], ends[2, 1] - 0.5 * drop * move[7], ends[2, 2] - 0.5 * drop * move[8]
    for a in range(_ANGLES):
        angle = _TWO_PI * (a + 0.5) / _ANGLES
        c, s = math.cos(angle), math.sin(angle)
        for r in range(_RINGS):
            rho = radius * (r + 0.5) / _RINGS
            x, y = x0 + rho * (c * fx + s * lx), y0 + rho * (c * fy + s * ly)
            z = z0 + rho * (c * fz + s * lz)
            i, j = round((x - columns.x0) / columns.cell), round((y - columns.y0) / columns.cell)
            if 0 <= i < nx and 0 <= j < ny:
                for k in range(columns.held[j, i]):
                    if columns.low[k, j, i] < z < columns.high[k, j, i]:
                        sum_f += c
                        sum_l += s
    area = radius / _RINGS * _TWO_PI / _ANGLES
    return sum_f * area, sum_l * area
