"""Feed frame on any path in space: along the feed, across it, and along the tool as far as square to both."""

from __future__ import annotations

import math

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel

LEAST_SINE = 0.02
"""Sine of the angle between feed and tool axis below which they give no direction across: plunging."""


@kernel("void(float64, float64, float64, float64, float64, float64, float64[::1], float64[::1])")
def feed_frame(vx: float, vy: float, vz: float, ax: float, ay: float, az: float, memory: Float, frame: Float) -> None:
    """Right-handed axes of the feed: t along it, n = a x t across it, b = t x n.

    On a level path b is the tool axis, and n points to the left of the feed seen from the spindle (the tool's z points
    out of the spindle, so ``a`` is minus that). Where the feed runs along the tool, n is kept from before, made square
    to the feed; a path that plunges and goes on has one continuous frame. Where nothing moves the last feed counts.

    Args:
        vx: Unit feed direction, part axes; zero where nothing moves.
        vy: Likewise.
        vz: Likewise.
        ax: Unit vector from the tool tip towards the spindle.
        ay: Likewise.
        az: Likewise.
        memory: (6,) last t and n; zeros at the start. Changed.
        frame: (9,) written: t, n, b by rows; orthonormal.
    """
    if vx * vx + vy * vy + vz * vz < 0.25:
        vx, vy, vz = memory[0], memory[1], memory[2]
        if vx * vx + vy * vy + vz * vz < 0.25:
            vx, vy, vz = 1.0, 0.0, 0.0
    nx, ny, nz = ay * vz - az * vy, az * vx - ax * vz, ax * vy - ay * vx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    if size < LEAST_SINE:
        along = memory[3] * vx + memory[4] * vy + memory[5] * vz
        nx, ny, nz = memory[3] - along * vx, memory[4] - along * vy, memory[5] - along * vz
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        if size < 0.1:  # nothing from before, or the feed turned into it: any direction square to the feed
            if abs(vx) <= abs(vy) and abs(vx) <= abs(vz):
                nx, ny, nz = 1.0 - vx * vx, -vx * vy, -vx * vz
            elif abs(vy) <= abs(vz):
                nx, ny, nz = -vx * vy, 1.0 - vy * vy, -vy * vz
            else:
                nx, ny, nz = -vx * vz, -vy * vz, 1.0 - vz * vz
            size = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / size, ny / size, nz / size
    frame[0], frame[1], frame[2] = vx, vy, vz
    frame[3], frame[4], frame[5] = nx, ny, nz
    frame[6], frame[7], frame[8] = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
    for k in range(6):
        memory[k] = frame[k]
