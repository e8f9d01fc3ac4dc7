"""Kernel: cut one short step of a tool of any direction out of columns and say what it removed.

What :func:`counterflex.cutting.sweep_kernels.stamp_segment` is for the height map, for step-by-step loops inside other
kernels, where a step is a fraction of a millimetre and thousands follow each other. The tool is placed at ends of parts
of the step, each no longer than :data:`PART_M`, and what lies within it is taken out: between two places a cylinder
leaves ``d^2 / (8 R)``, tens of nanometres. What was taken is booked where it lies on the cutter in the middle of the
part, by level and immersion angle, as :func:`~counterflex.cutting.tridexel.columns.remove_turning` books the whole
sweep. A column whose material ends below the tool's end face is passed by with one product.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from counterflex.core.arrays import Float, Float1, Float2, Float32
from counterflex.core.jit import bundle, kernel
from counterflex.core.units import MM
from counterflex.cutting.booking_kernels import BINS
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.removal import unit_widths
from counterflex.cutting.tridexel.column_block_kernels import MOST_STRETCHES, take
from counterflex.cutting.tridexel.columns import ColumnStock, shape_of
from counterflex.cutting.tridexel.swept_solid import stretch

UInt8 = npt.NDArray[np.uint8]

PART_M: Final = 0.1 * MM
_PIECES: Final = 20.0
"""Pieces that a stretch as long as the radius of the cutter is booked in."""
RIDGE_M: Final = 0.05 * MM
"""Thinner stretches are dropped where room is short: ridges between two places of the tool."""
SPARE: Final = 4
"""Stretches that a column has room for where a row begins; most rows give it none, few give it one."""
_TINY_M: Final = 1.0e-9
_FAR: Final = 1.0e9
_STEEP: Final = 0.2
"""Cosine of the tilt below which the end face no longer bounds what the tool can reach in a column."""


class StepColumns(NamedTuple):
    """Columns as the kernel takes them: ends (layers, ny, nx), stretches (ny, nx), first centre, side, highest end."""

    low: Annotated[Float32, "float32[:, :, ::1]"]
    high: Annotated[Float32, "float32[:, :, ::1]"]
    held: Annotated[UInt8, "uint8[:, ::1]"]
    x0: float
    y0: float
    cell: float
    top: float


class StepSpace(NamedTuple):
    """Shape of a cutter, and working space. Made by :func:`step_space`.

    ``motion`` (9,) is what the kernel leaves there: start of the tip, displacement of the point that the step turns
    about, tool axis in the middle of the step.
    """

    shape: Float1
    radii: Float1
    unit_width: Float1
    motion: Float1
    work: Float1
    piece: Float2


STEP_COLUMNS: Final = bundle(StepColumns)
STEP_SPACE: Final = bundle(StepSpace)


def step_columns(stock: ColumnStock) -> StepColumns:
    """The columns of a stock; they share its arrays."""
    layer = np.arange(len(stock.high))[:, None, None]
    top = float(stock.high.max(initial=-np.inf, where=layer < stock.count))
    return StepColumns(stock.low, stock.high, stock.count, stock.x0_m, stock.y0_m, stock.cell_m, top)


def step_space(cutter: Cutter, top_m: float) -> StepSpace:
    """Shape and working space of a cutter that takes material away up to ``top_m`` above its tip."""
    return StepSpace(
        np.ascontiguousarray(shape_of(cutter, top_m)),
        np.ascontiguousarray(cutter.level_radii()),
        unit_widths(),
        np.zeros(9),
        np.zeros(19),
        np.zeros((MOST_STRETCHES, 2)),
    )


@kernel(
    "float64(Columns, Space, float64[:], float64[:], float64[:], float64[:], float64, boolean, float64[:, ::1],"
    " float64[::1])",
    Columns=STEP_COLUMNS,
    Space=STEP_SPACE,
)
def cut_step(
    columns: StepColumns,
    space: StepSpace,
    tip_a: Float,
    axis_a: Float,
    tip_b: Float,
    axis_b: Float,
    height: float,
    book: bool,
    depth_out: Float,
    extra_out: Float,
) -> float:
    """Cut a step and say what it removed.

    The feed of the step is that of the point of the axis at ``height``, square to the axis in the middle:
    ``d = b - a + height (u_b - u_a)``.

    Args:
        columns: Of the stock, cut in place.
        space: See :class:`StepSpace`; its ``motion`` is written.
        tip_a: (3,) m, tool tip at the start of the step, part frame.
        axis_a: (3,) unit vector from the tip to the spindle there.
        tip_b: (3,) m, tip at its end.
        axis_b: (3,) axis at its end.
        height: Height above the tip of the point whose way is the feed, m.
        book: Book what is removed; without it ``depth_out`` stays zero.
        depth_out: (n_levels, 64) overwritten: axial length in m of the edge engaged at each level and immersion angle
            about the tool axis, averaged over the step: removed volume / (L R_level (cos phi_j - cos phi_j+1)) with L
            the length of the feed. Zero where there is no feed.
        extra_out: (2,) overwritten: volume removed by the end face, m^3 (part of the total, not in ``depth_out``); 0.

    Returns:
        Volume removed, m^3; -1 where a column would hold too many stretches of material.
    """
    motion, work = space.motion, space.work
    depth_out[:] = 0.0
    extra_out[:] = 0.0
    size, along, longest = 0.0, 0.0, 0.0
    for k in range(3):
        motion[6 + k] = axis_a[k] + axis_b[k]
        size += motion[6 + k] * motion[6 + k]
    size = math.sqrt(size)
    tip_way, top_way = 0.0, 0.0
    for k in range(3):
        motion[6 + k] /= size
        motion[k] = tip_a[k]
        motion[3 + k] = tip_b[k] - tip_a[k] + height * (axis_b[k] - axis_a[k])
        along += motion[3 + k] * motion[6 + k]
        tip_way += (tip_b[k] - tip_a[k]) ** 2
        top_way += (tip_b[k] - tip_a[k] + 2.0 * space.shape[0] * (axis_b[k] - axis_a[k])) ** 2
    longest = math.sqrt(max(tip_way, top_way))
    feed = 0.0
    for k in range(3):
        work[k] = motion[3 + k] - along * motion[6 + k]
        feed += work[k] * work[k]
    feed = math.sqrt(feed)
    parts = max(1, math.ceil(longest / PART_M))
    removed = 0.0
    for n in range(parts):
        _set_pose(work, 3, tip_a, axis_a, tip_b, axis_b, n / parts)
        _set_pose(work, 6, tip_a, axis_a, tip_b, axis_b, (n + 0.5) / parts)
        _set_pose(work, 12, tip_a, axis_a, tip_b, axis_b, (n + 1.0) / parts)
        taken = _place(columns, space, feed, along, book, depth_out, extra_out)
        if taken < 0.0:
            return -1.0
        removed += taken
    if feed > 0.0 and removed > 0.0:
        levels = depth_out.shape[0]
        for level in range(levels):
            per = 1.0 / (feed * space.radii[level])
            for j in range(BINS):
                depth_out[level, j] *= per / space.unit_width[j]
    return removed


@kernel()
def _set_pose(out: Float, at: int, tip_a: Float, axis_a: Float, tip_b: Float, axis_b: Float, share: float) -> None:
    """Write tip and, behind it where it is asked for, the axis at a share of the step."""
    size = 0.0
    for k in range(3):
        out[at + k] = tip_a[k] + share * (tip_b[k] - tip_a[k])
        if at >= 6:
            out[at + 3 + k] = axis_a[k] + share * (axis_b[k] - axis_a[k])
            size += out[at + 3 + k] ** 2
    if at >= 6:
        size = math.sqrt(size)
        for k in range(3):
            out[at + 3 + k] /= size


@kernel()
def _place(
    columns: StepColumns, space: StepSpace, feed: float, along: float, book: bool, depth: Float, extra: Float
) -> float:
    """Take away what lies within the tool at the end of a part of the step; returns the volume, -1: no room."""
    shape, work, piece = space.shape, space.work, space.piece
    ny, nx = columns.held.shape
    cell, radius, corner, top = columns.cell, shape[0], shape[1], shape[2]
    px, py, pz, ux, uy, uz = work[12], work[13], work[14], work[15], work[16], work[17]
    if uz > _STEEP:
        top = min(top, max(0.0, columns.top - pz) / uz + radius)  # above, no material is
    x_low, x_high = px + min(0.0, top * ux) - radius, px + max(0.0, top * ux) + radius
    y_low, y_high = py + min(0.0, top * uy) - radius, py + max(0.0, top * uy) + radius
    i_low, i_high = (
        max(0, math.ceil((x_low - columns.x0) / cell)),
        min(nx - 1, math.floor((x_high - columns.x0) / cell)),
    )
    j_low, j_high = (
        max(0, math.ceil((y_low - columns.y0) / cell)),
        min(ny - 1, math.floor((y_high - columns.y0) / cell)),
    )
    slope_x, slope_y, lowest = 0.0, 0.0, pz + min(0.0, top * uz) - radius
    if uz > _STEEP:
        slope_x, slope_y, lowest = -ux / uz, -uy / uz, pz
    finest = radius / _PIECES
    total = 0.0
    for j in range(j_low, j_high + 1):
        dy = columns.y0 + cell * j - py
        for i in range(i_low, i_high + 1):
            n = int(columns.held[j, i])
            if n == 0:
                continue
            dx = columns.x0 + cell * i - px
            if columns.high[n - 1, j, i] <= lowest + slope_x * dx + slope_y * dy + _TINY_M:
                continue
            one, two = _within(work, dx, dy, radius, corner, top, shape)
            if two <= one:
                continue
            taken = take(columns, j, i, one + pz, two + pz, piece)
            if taken < 0:
                return -1.0
            if columns.held[j, i] + SPARE > columns.low.shape[0]:
                work[18] = 1.0
            for k in range(taken):
                tall = piece[k, 1] - piece[k, 0]
                total += tall
                if book:
                    count = 1 + int(tall / finest)
                    for m in range(count):
                        z = piece[k, 0] + (m + 0.5) * tall / count
                        x, y = columns.x0 + cell * i, columns.y0 + cell * j
                        _book(space, x, y, z, tall / count * cell * cell, cell, feed, along, depth, extra)
    return total * cell * cell


@kernel()
def _within(
    work: Float, dx: float, dy: float, radius: float, corner: float, top: float, shape: Float
) -> tuple[float, float]:
    """Heights above the tip between which a column, (dx, dy) from it, lies within the tool."""
    ux, uy, uz = work[15], work[16], work[17]
    round_end = corner > 0.0
    ball = round_end and radius - corner < 1.0e-12
    if round_end and not ball:
        q = np.array([dx, dy, 0.0])
        motion = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ux, uy, uz])
        return stretch(q, 2, motion, shape)
    alpha = ux * dx + uy * dy
    ax, ay, az = dx - alpha * ux, dy - alpha * uy, -alpha * uz
    rest = ax * ax + ay * ay + az * az - radius * radius
    bb = 1.0 - uz * uz
    first, last = 1.0, -1.0
    if bb > 1.0e-18:
        ab = -alpha * uz  # a . (z - uz u), and a is square to u
        square = ab * ab - bb * rest
        if square > 0.0:
            root = math.sqrt(square)
            first, last = (-ab - root) / bb, (-ab + root) / bb
    elif rest < 0.0:
        first, last = -_FAR, _FAR
    if last > first:
        if abs(uz) > 1.0e-12:
            a, b = (corner - alpha) / uz, (top - alpha) / uz
            first, last = max(first, min(a, b)), min(last, max(a, b))
        elif not corner <= alpha <= top:
            first, last = 1.0, -1.0
    if ball:
        cx, cy = dx - corner * ux, dy - corner * uy
        square = corner * corner - cx * cx - cy * cy
        if square > 0.0:
            root = math.sqrt(square)
            if last > first:
                return min(first, corner * uz - root), max(last, corner * uz + root)
            return corner * uz - root, corner * uz + root
    return first, last


@kernel()
def _book(
    space: StepSpace,
    x: float,
    y: float,
    z: float,
    volume: float,
    cell: float,
    feed: float,
    along: float,
    depth: Float,
    extra: Float,
) -> None:
    """Book a volume of a column at a point of the part; volumes are added to ``depth``, which is divided later."""
    work, shape = space.work, space.shape
    if feed <= 0.0:
        extra[0] += volume
        return
    ux, uy, uz = work[9], work[10], work[11]
    qx, qy, qz = x - work[6], y - work[7], z - work[8]
    h = qx * ux + qy * uy + qz * uz
    rx, ry, rz = qx - h * ux, qy - h * uy, qz - h * uz
    rho = max(math.sqrt(rx * rx + ry * ry + rz * rz), 1.0e-12)
    fx, fy, fz = work[0] / feed, work[1] / feed, work[2] / feed
    ahead = (rx * fx + ry * fy + rz * fz) / rho
    radius, corner, share = shape[0], shape[1], 1.0
    # a point is first met on the outline, as far to the left of the feed as it stays
    rim = radius if h >= corner else radius - corner + math.sqrt(max(corner * corner - (corner - h) ** 2, 0.0))
    left = rx * (uy * fz - uz * fy) + ry * (uz * fx - ux * fz) + rz * (ux * fy - uy * fx)
    inside = rim - abs(left)
    if inside < 0.5 * cell:  # the middle of that part of the column which the outline covers
        left = math.copysign(rim - 0.5 * min(inside + 0.5 * cell, rim), left)
    left /= max(rim, 1.0e-12)
    if along < 0.0:
        if corner == 0.0:
            # what lay beside the tool before this part of the step is met by the side, what lay below by the end face
            sx, sy, sz = x - work[3], y - work[4], z - work[5]
            t = sx * ux + sy * uy + sz * uz
            outside = sx * sx + sy * sy + sz * sz - t * t
            share = 1.0 if outside > radius * radius else 0.0
        else:
            radial, axial = max(rho - radius + corner, 0.0), max(corner - h, 0.0)
            side, down = max(radial * ahead, 0.0) * feed, -along * axial
            share = side / (side + down) if side + down > 0.0 else 1.0
    extra[0] += (1.0 - share) * volume
    phi = math.acos(min(1.0, max(-1.0, left)))
    level = 0
    while level < int(shape[3]) and h > shape[5 + level]:
        level += 1
    depth[level, min(int(phi * (BINS / math.pi)), BINS - 1)] += share * volume
