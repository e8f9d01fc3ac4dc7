"""Kernels: the frame of a motion, what of it can reach a block of columns, and what the motion before it has taken.

A motion (12,) is the start of the tip, its displacement, the tool axis in the middle and the turn: at the share s of
the motion the axis points along ``middle + (s - 1/2) turn``, the turn square to the middle.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.cutting.envelope_kernels import Real

SPEED: Final = 9
OMEGA: Final = 12
TIP: Final = 13
FRAME: Final = 16
"""Places in a frame: w, e, h as rows, displacement in them, turn, tip in the middle of the motion in the part frame."""

_TIPS: Final = 4
_AXES: Final = 10
_SINE: Final = 16
_LOWEST: Final = 18
_SLACK: Final = 19
_NORMALS: Final = 20
_GRADE: Final = 28
_RADIUS: Final = 32
_BALL: Final = 33
_TOP: Final = 34
BOUNDS: Final = 35
"""Places in the bounds: box (low x, low y, high x, high y), both tips, both axes, sines of their tilts, ..."""
_SAME_M: Final = 2.0e-8
_LEVEL_M: Final = 1.0e-9


@kernel()
def frame_of(motion: Float, frame: Float) -> None:
    """Fill the frame of a motion."""
    ux, uy, uz = motion[6], motion[7], motion[8]
    wx, wy, wz = motion[9], motion[10], motion[11]
    omega = math.sqrt(wx * wx + wy * wy + wz * wz)
    if omega < 1.0e-12:
        omega = 0.0
        wx, wy, wz = (1.0, 0.0, 0.0) if abs(ux) < 0.8 else (0.0, 1.0, 0.0)
    along = wx * ux + wy * uy + wz * uz
    wx, wy, wz = wx - along * ux, wy - along * uy, wz - along * uz
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    wx, wy, wz = wx / size, wy / size, wz / size
    frame[0], frame[1], frame[2] = wx, wy, wz
    frame[3], frame[4], frame[5] = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    frame[6], frame[7], frame[8] = ux, uy, uz
    for c in range(3):
        frame[SPEED + c] = frame[3 * c] * motion[3] + frame[3 * c + 1] * motion[4] + frame[3 * c + 2] * motion[5]
        frame[TIP + c] = motion[c] + 0.5 * motion[3 + c]
    frame[OMEGA] = omega


@kernel()
def bounds_of(motion: Float, tool: Float, ceiling: float, steep: float, bounds: Float) -> bool:
    """Fill the bounds of a motion; True where the tool lies flatter than a cosine, or its top is in the material."""
    radius, top = tool[0], tool[2]
    square = 0.0
    for c in range(3):
        square += motion[9 + c] * motion[9 + c]
    per = 1.0 / math.sqrt(1.0 + 0.25 * square)
    slowly, reach = False, 0.0
    for end in range(2):
        tip, axis = _TIPS + 3 * end, _AXES + 3 * end
        for c in range(3):
            bounds[tip + c] = motion[c] + end * motion[3 + c]
            bounds[axis + c] = (motion[6 + c] + (end - 0.5) * motion[9 + c]) * per
        z, uz = bounds[tip + 2], bounds[axis + 2]
        sine = math.hypot(bounds[axis], bounds[axis + 1])
        bounds[_SINE + end] = sine
        slowly = slowly or uz < steep or z + top * uz - radius * sine < ceiling
    for end in range(2):
        z, uz = bounds[_TIPS + 3 * end + 2], bounds[_AXES + 3 * end + 2]
        high = top
        if not slowly:
            high = min(max((ceiling - z + radius * bounds[_SINE + end]) / uz, 0.0), top)
        reach = max(reach, high)
    length = math.sqrt(motion[3] * motion[3] + motion[4] * motion[4] + motion[5] * motion[5])
    slack = ((reach + radius) * math.sqrt(square) + length) * math.sqrt(square) / 8.0 + 1.0e-9
    bounds[0], bounds[1], bounds[2], bounds[3], bounds[_LOWEST] = 1.0e30, 1.0e30, -1.0e30, -1.0e30, 1.0e30
    for end in range(2):
        tip, axis = _TIPS + 3 * end, _AXES + 3 * end
        for h in (0.0, reach):
            for c in range(2):
                at = bounds[tip + c] + h * bounds[axis + c]
                bounds[c] = min(bounds[c], at - radius - slack)
                bounds[2 + c] = max(bounds[2 + c], at + radius + slack)
            z = bounds[tip + 2] + h * bounds[axis + 2] - radius * bounds[_SINE + end] - slack
            bounds[_LOWEST] = min(bounds[_LOWEST], z)
        for c in range(2):
            bounds[_GRADE + 2 * end + c] = bounds[axis + c] / max(bounds[axis + 2], 1.0e-9)
    lx, ly = bounds[_AXES] + bounds[_AXES + 3], bounds[_AXES + 1] + bounds[_AXES + 4]
    lean, length = math.hypot(lx, ly), math.hypot(motion[3], motion[4])
    bounds[_NORMALS], bounds[_NORMALS + 1] = (-ly / lean, lx / lean) if lean > 1.0e-6 else (1.0, 0.0)
    bounds[_NORMALS + 2], bounds[_NORMALS + 3] = (
        (-motion[4] / length, motion[3] / length) if length > 1.0e-9 else (0.0, 1.0)
    )
    bounds[_NORMALS + 4], bounds[_NORMALS + 5], bounds[_NORMALS + 6], bounds[_NORMALS + 7] = 1.0, 0.0, 0.0, 1.0
    bounds[_SLACK], bounds[_RADIUS], bounds[_TOP] = slack, radius, top
    bounds[_BALL] = 1.0 if tool[1] == radius else 0.0
    return slowly


@kernel()
def _aside(bounds: Float, x: Real, y: Real, half_x: Real, half_y: Real, z_top: Real) -> bool:
    """Return whether the part of a sweep below a height certainly misses a rectangle, seen along z."""
    radius, slack = bounds[_RADIUS], bounds[_SLACK]
    high0 = (z_top - bounds[_TIPS + 2] + radius * bounds[_SINE]) / bounds[_AXES + 2]
    high1 = (z_top - bounds[_TIPS + 5] + radius * bounds[_SINE + 1]) / bounds[_AXES + 5]
    high0, high1 = min(max(high0, 0.0), bounds[_TOP]), min(max(high1, 0.0), bounds[_TOP])
    for n in range(4):
        nx, ny = bounds[_NORMALS + 2 * n], bounds[_NORMALS + 2 * n + 1]
        one = nx * bounds[_TIPS] + ny * bounds[_TIPS + 1]
        two = nx * bounds[_TIPS + 3] + ny * bounds[_TIPS + 4]
        three = one + high0 * (nx * bounds[_AXES] + ny * bounds[_AXES + 1])
        four = two + high1 * (nx * bounds[_AXES + 3] + ny * bounds[_AXES + 4])
        middle, reach = nx * x + ny * y, abs(nx) * half_x + abs(ny) * half_y + radius + slack
        if middle + reach < min(one, two, three, four) or middle - reach > max(one, two, three, four):
            return True
    return False


@kernel()
def _least_height(bounds: Float, x: Real, y: Real, half_x: Real, half_y: Real) -> float:
    """A height below which no column of a rectangle is cut: that of the end face, and of a ball."""
    radius, least = bounds[_RADIUS], 1.0e30
    for end in range(2):
        gx, gy = bounds[_GRADE + 2 * end], bounds[_GRADE + 2 * end + 1]
        tip = _TIPS + 3 * end
        z = bounds[tip + 2] - gx * (x - bounds[tip]) - gy * (y - bounds[tip + 1]) - abs(gx) * half_x - abs(gy) * half_y
        least = min(least, z)
    least -= bounds[_SLACK]
    if bounds[_BALL] == 0.0:
        return float(least)
    ax, ay = bounds[_TIPS] + radius * bounds[_AXES], bounds[_TIPS + 1] + radius * bounds[_AXES + 1]
    bx, by = bounds[_TIPS + 3] + radius * bounds[_AXES + 3], bounds[_TIPS + 4] + radius * bounds[_AXES + 4]
    az, bz = bounds[_TIPS + 2] + radius * bounds[_AXES + 2], bounds[_TIPS + 5] + radius * bounds[_AXES + 5]
    vx, vy = bx - ax, by - ay
    size = vx * vx + vy * vy
    s = 0.0 if size <= 0.0 else min(max(((x - ax) * vx + (y - ay) * vy) / size, 0.0), 1.0)
    away = math.hypot(x - ax - s * vx, y - ay - s * vy) - math.hypot(half_x, half_y) - bounds[_SLACK]
    ball = 1.0e30
    if away < radius:
        away = max(away, 0.0)
        ball = min(az, bz) - math.sqrt(radius * radius - away * away) - bounds[_SLACK]
    return float(min(max(least, ball), least + radius))


@kernel()
def missed(bounds: Float, x: Real, y: Real, half_x: Real, half_y: Real, z_top: Real, slowly: bool) -> bool:
    """Return whether a motion certainly takes nothing out of the columns of a rectangle about (x, y) m.

    Args:
        x: Middle of the rectangle, m.
        half_x: Half its sides, between the outer columns, m.
        z_top: Its highest material, m.
        slowly: What :func:`bounds_of` returned.
    """
    if z_top <= bounds[_LOWEST]:
        return True
    if x + half_x < bounds[0] or x - half_x > bounds[2] or y + half_y < bounds[1] or y - half_y > bounds[3]:
        return True
    if slowly:
        return False
    return bool(_aside(bounds, x, y, half_x, half_y, z_top) or z_top <= _least_height(bounds, x, y, half_x, half_y))


@kernel()
def already_cut(
    bounds: Float, turn: Float, corner: float, x: Real, y: Real, half_x: Real, half_y: Real, z_top: Real
) -> bool:
    """Return whether the pose in which a motion begins has cut all columns of a rectangle as deep as the motion will.

    So it is where every column meets the end face, or the ball, as the motion begins, and the face does not go down
    from there; what lies above it was taken then.

    Args:
        turn: (3,) of the axis in the motion.
        corner: Corner radius, m.
        x: Middle of the rectangle, m.
        half_x: Half its sides, m.
        z_top: Its highest material, m.
    """
    radius, ball = bounds[_RADIUS], bounds[_BALL] != 0.0
    tx, ty, tz = bounds[_TIPS], bounds[_TIPS + 1], bounds[_TIPS + 2]
    ux, uy, uz = bounds[_AXES], bounds[_AXES + 1], bounds[_AXES + 2]
    vx, vy, vz = bounds[_TIPS + 3] - tx, bounds[_TIPS + 4] - ty, bounds[_TIPS + 5] - tz
    highest = -1.0e30
    if ball:
        vx, vy, vz = vx + radius * turn[0], vy + radius * turn[1], vz + radius * turn[2]
        tx, ty, tz = tx + radius * ux, ty + radius * uy, tz + radius * uz
        margin = 2.0 * abs(vz) * (half_x * half_x + half_y * half_y) / radius
        for n in range(4):
            dx = x + (half_x if n % 2 == 0 else -half_x) - tx
            dy = y + (half_y if n < 2 else -half_y) - ty
            rest = radius * radius - dx * dx - dy * dy
            if rest <= 0.1 * radius * radius:  # near the side of the ball it may leave something above itself
                return False
            q = math.sqrt(rest)
            if dx * ux + dy * uy - q * uz > 0.0 or dx * vx + dy * vy - q * vz > -margin:
                return False
            highest = max(highest, tz - q)
        return bool(z_top <= highest + _SAME_M)
    inner = radius - corner - 2.0 * math.hypot(half_x, half_y) * math.hypot(ux, uy)  # as above
    if inner <= 0.0:
        return False
    for n in range(4):
        dx = x + (half_x if n % 2 == 0 else -half_x) - tx
        dy = y + (half_y if n < 2 else -half_y) - ty
        dz = -(dx * ux + dy * uy) / uz
        if dx * dx + dy * dy + dz * dz > inner * inner:
            return False
        goes = dx * turn[0] + dy * turn[1] + dz * turn[2] - (vx * ux + vy * uy + vz * uz)
        later = vz - (dx - vx) * bounds[_GRADE + 2] - (dy - vy) * bounds[_GRADE + 3]
        if goes > _LEVEL_M or later < dz - _LEVEL_M:
            return False
        highest = max(highest, tz + dz)
    return bool(z_top <= highest + _SAME_M)
