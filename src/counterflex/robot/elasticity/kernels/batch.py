"""Batches of the scalar kernels: a serial loop over a range of points, and the same threaded.

Inputs are (n, 6) C-ordered and writable; ``out`` arrays are filled in place. The threaded forms must not be called from
the online process. Their threads are Python's: Numba's own parallel loops are compiled twice as long.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel, thread_count
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.scalar import (
    balance_torque,
    chain_pass,
    growth_at,
    joint_trig,
    loads,
    pose_difference,
    rigid_jacobian,
    tcp_compliance,
)


@kernel("void(Chain, float64[::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1])", Chain=CHAIN)
def weight_torque(chain: Compact, q: Float, frame: Float, still: Float, trig: Float, out: Float) -> None:
    """Torque of weight, payload and counterbalance about each axis, positive in its positive direction; rigid geometry.

    ``T_j = sign_j z_j . sum_k m_k (p_k - p_j) x g`` over the bodies k from the axis outward, and the counterbalance's
    on its axis, as :func:`counterflex.robot.elasticity.play.axis_torque` for a batch.

    Args:
        chain: Compact chain.
        q: (6,) rad.
        frame: (m + 1, 12) work array.
        still: (m, 6) zeros.
        trig: (12,) work array.
        out: (6,) N m, written.
    """
    m = len(chain.stations) - 1
    joint_trig(q, trig)
    chain_pass(chain, trig, still, 0, frame)
    surroundings = chain.surroundings[0]
    gx, gy, gz = surroundings.gravity[0], surroundings.gravity[1], surroundings.gravity[2]
    sx, sy, sz = 0.0, 0.0, 0.0
    for k in range(6):
        out[k] = 0.0
    for n in range(m):
        i = m - 1 - n
        f, s = frame[i], chain.stations[i]
        mass, carried = s.mass, s.carried
        a, b, c = s.com[0], s.com[1], s.com[2]
        sx += mass * (f[9] + f[0] * a + f[1] * b + f[2] * c)
        sy += mass * (f[10] + f[3] * a + f[4] * b + f[5] * c)
        sz += mass * (f[11] + f[6] * a + f[7] * b + f[8] * c)
        joint = s.drive
        if joint >= 0:
            hx, hy, hz = sx - carried * f[9], sy - carried * f[10], sz - carried * f[11]
            mx, my, mz = hy * gz - hz * gy, hz * gx - hx * gz, hx * gy - hy * gx
            out[joint] += s.sign * (f[2] * mx + f[5] * my + f[8] * mz)
        turning = s.balanced
        if turning != 0:
            out[abs(turning) - 1] += balance_torque(surroundings, q[abs(turning) - 1])


@kernel(
    "int64(Chain, float64[::1], float64[::1], float64[::1], int64, float64[:, ::1], float64[:, ::1])",
    Chain=CHAIN,
)
def settle(chain: Compact, trig: Float, q: Float, w: Float, gravity: int, delta: Float, frame: Float) -> int:
    """Equilibrium with the loads on the deflected geometry, by fixed-point iteration from the rigid one.

    Each virtual joint (three slides, then hinges z, y', x'') carries the generalised force of everything beyond it
    where that is after deflection; the wrench keeps its base axes and follows the TCP. ``frame`` ends deflected.

    Returns:
        Iterations used, or -1 where they did not converge.
    """
    m = len(chain.stations) - 1
    chain_pass(chain, trig, delta, 0, frame)
    loads(chain, frame, q, w, gravity, delta)
    surroundings = chain.surroundings[0]
    gx, gy, gz = surroundings.gravity[0], surroundings.gravity[1], surroundings.gravity[2]
    last = 1e300
    for count in range(1, 60):
        chain_pass(chain, trig, delta, 1, frame)
        tip = frame[m]
        sx, sy, sz = 0.0, 0.0, 0.0
        change = 0.0
        for k in range(m):
            i = m - 1 - k
            f, s = frame[i], chain.stations[i]
            a, b, c = delta[i, 0], delta[i, 1], delta[i, 2]
            px = f[9] + f[0] * a + f[1] * b + f[2] * c
            py = f[10] + f[3] * a + f[4] * b + f[5] * c
            pz = f[11] + f[6] * a + f[7] * b + f[8] * c
            ca, sa, cb, sb = math.cos(delta[i, 3]), math.sin(delta[i, 3]), math.cos(delta[i, 4]), math.sin(delta[i, 4])
            cc, sc = math.cos(delta[i, 5]), math.sin(delta[i, 5])
            # axes after the hinge about z (h: x', y'), after the one about y' (x''), and of the body (y3, z3)
            hx, hy, hz = cc * f[0] + sc * f[1], cc * f[3] + sc * f[4], cc * f[6] + sc * f[7]
            yx, yy, yz = cc * f[1] - sc * f[0], cc * f[4] - sc * f[3], cc * f[7] - sc * f[6]
            xx, xy, xz = cb * hx - sb * f[2], cb * hy - sb * f[5], cb * hz - sb * f[8]
            vx, vy, vz = cb * f[2] + sb * hx, cb * f[5] + sb * hy, cb * f[8] + sb * hz
            lx, ly, lz = tip[9] - px, tip[10] - py, tip[11] - pz
            fx, fy, fz = w[0], w[1], w[2]
            mx = w[3] + ly * fz - lz * fy
            my = w[4] + lz * fx - lx * fz
            mz = w[5] + lx * fy - ly * fx
            twist = 0.0
            if gravity != 0:
                mass = s.mass
                a, b, c = s.com[0], s.com[1], s.com[2]
                b, c = ca * b - sa * c, sa * b + ca * c
                sx += mass * (px + a * xx + b * yx + c * vx)
                sy += mass * (py + a * xy + b * yy + c * vy)
                sz += mass * (pz + a * xz + b * yz + c * vz)
                carried = s.carried
                ox, oy, oz = sx - carried * px, sy - carried * py, sz - carried * pz
                fx += carried * gx
                fy += carried * gy
                fz += carried * gz
                mx += oy * gz - oz * gy
                my += oz * gx - ox * gz
                mz += ox * gy - oy * gx
                if s.balanced != 0:
                    twist = balance_torque(surroundings, q[abs(s.balanced) - 1])
                    twist = twist if s.balanced > 0 else -twist
            for d in range(6):
                if d == 0:
                    load = f[0] * fx + f[3] * fy + f[6] * fz
                elif d == 1:
                    load = f[1] * fx + f[4] * fy + f[7] * fz
                elif d == 2:
                    load = f[2] * fx + f[5] * fy + f[8] * fz
                elif d == 3:
                    load = xx * mx + xy * my + xz * mz
                elif d == 4:
                    load = yx * mx + yy * my + yz * mz
                else:
                    load = f[2] * mx + f[5] * my + f[8] * mz + twist
                new = s.compliance[d] * load
                if len(chain.regions) > 0:
                    new *= growth_at(chain.regions, i, d, q)
                change = max(change, abs(new - delta[i, d]))
                delta[i, d] = new
        # Rounding keeps the change of a soft chain above 1e-17 rad: once it no longer falls, and is below 1e-14, it is
        # rounding.
        if change < 1e-17 or (change >= last and change < 1e-14):
            chain_pass(chain, trig, delta, 1, frame)
            return count
        last = change
    return -1


CHUNK = 256  # fewest points that are worth a thread

RIGID, ON_RIGID, SETTLED = 0, 1, 2  # loads: none at all, on the rigid geometry, on the deflected geometry


@kernel(
    "int64(Chain, float64[::1], float64[::1], float64[::1], int64, int64, float64[:, ::1], float64[:, ::1])",
    Chain=CHAIN,
)
def load_pose(
    chain: Compact, trig: Float, q: Float, w: Float, how: int, gravity: int, delta: Float, frame: Float
) -> int:
    """Leave the pose of the TCP under load in the last row of ``frame``; 1 where the equilibrium did not converge."""
    if how == SETTLED:
        return 0 if settle(chain, trig, q, w, gravity, delta, frame) >= 0 else 1
    chain_pass(chain, trig, delta, 0, frame)
    if how == ON_RIGID:
        loads(chain, frame, q, w, gravity, delta)
        chain_pass(chain, trig, delta, 1, frame)
    return 0


@kernel(
    "int64(Chain, float64[:, ::1], float64[:, ::1], int64, int64, float64[:, :, ::1], int64, int64)",
    waits=True,
    Chain=CHAIN,
    entry=True,
)
def pose_range(chain: Compact, q: Float, w: Float, how: int, gravity: int, out: Float, first: int, last: int) -> int:
    """Poses (n, 4, 4) of the TCP under load for the points first..last-1; number that did not converge."""
    m = len(chain.stations) - 1
    frame, delta, trig = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12)
    failed = 0
    for n in range(first, last):
        joint_trig(q[n], trig)
        failed += load_pose(chain, trig, q[n], w[n], how, gravity, delta, frame)
        for r in range(3):
            for c in range(3):
                out[n, r, c] = frame[m, 3 * r + c]
            out[n, r, 3] = frame[m, 9 + r]
        out[n, 3, 0], out[n, 3, 1], out[n, 3, 2], out[n, 3, 3] = 0.0, 0.0, 0.0, 1.0
    return failed


@kernel(
    "int64(Chain, float64[:, ::1], float64[:, ::1], int64, int64, float64[:, ::1], int64, int64)",
    waits=True,
    Chain=CHAIN,
    entry=True,
)
def deflection_range(
    chain: Compact, q: Float, w: Float, how: int, gravity: int, out: Float, first: int, last: int
) -> int:
    """Deflections (n, 6), pose under load minus pose without, for the points first..last-1; number not converged."""
    m = len(chain.stations) - 1
    frame, delta, trig = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12)
    before, none = np.empty(12), np.zeros(6)
    failed = 0
    for n in range(first, last):
        joint_trig(q[n], trig)
        chain_pass(chain, trig, delta, 0, frame)
        if gravity != 0:
            failed += load_pose(chain, trig, q[n], none, how, gravity, delta, frame)
        before[:] = frame[m]
        failed += load_pose(chain, trig, q[n], w[n], how, gravity, delta, frame)
        pose_difference(before, frame[m], out[n])
    return failed


@kernel("int64(Chain, float64[:, ::1], int64, float64[:, ::1], int64, int64)", Chain=CHAIN, entry=True)
def sag_range(chain: Compact, q: Float, how: int, out: Float, first: int, last: int) -> int:
    """Sag (n, 6), pose under own weight minus weightless pose, for the points first..last-1; number not converged."""
    m = len(chain.stations) - 1
    frame, delta, trig = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12)
    before, none = np.empty(12), np.zeros(6)
    failed = 0
    for n in range(first, last):
        joint_trig(q[n], trig)
        chain_pass(chain, trig, delta, 0, frame)
        before[:] = frame[m]
        failed += load_pose(chain, trig, q[n], none, how, 1, delta, frame)
        pose_difference(before, frame[m], out[n])
    return failed


@kernel("void(Chain, float64[:, ::1], float64[:, ::1], int64, int64)", waits=True, Chain=CHAIN, entry=True)
def compliance_range(chain: Compact, q: Float, out: Float, first: int, last: int) -> None:
    """Cartesian compliances (n, 36) for the points first..last-1."""
    m = len(chain.stations) - 1
    frame, delta, trig = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12)
    for n in range(first, last):
        joint_trig(q[n], trig)
        chain_pass(chain, trig, delta, 0, frame)
        tcp_compliance(chain, frame, q[n], out[n])


@kernel("void(Chain, float64[:, ::1], float64[:, ::1], int64, int64)", Chain=CHAIN, entry=True)
def jacobian_range(chain: Compact, q: Float, out: Float, first: int, last: int) -> None:
    """Rigid Jacobians (n, 36) for the points first..last-1."""
    m = len(chain.stations) - 1
    frame, delta, trig = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12)
    for n in range(first, last):
        joint_trig(q[n], trig)
        chain_pass(chain, trig, delta, 0, frame)
        rigid_jacobian(chain, frame, out[n])


@functools.cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="batch")


def _in_threads(work: Callable[[int, int], int | None], count: int) -> int:
    """Do a range of points in several threads, some chunks each; a compiled range lets other threads run meanwhile."""
    # `work` does the points first..last-1 and may give a number; the sum of these is returned.
    if count <= CHUNK:
        return work(0, count) or 0
    threads = thread_count()
    size = max(CHUNK, -(-count // (4 * threads)))
    parts = [(first, min(count, first + size)) for first in range(0, count, size)]
    return sum(number or 0 for number in _threads(threads).map(lambda part: work(*part), parts))


def pose_threads(chain: Compact, q: Float, w: Float, how: int, gravity: int, out: Float) -> int:
    """Threaded :func:`pose_range` over all points."""
    return _in_threads(lambda a, b: pose_range(chain, q, w, how, gravity, out, a, b), len(q))


def deflection_threads(chain: Compact, q: Float, w: Float, how: int, gravity: int, out: Float) -> int:
    """Threaded :func:`deflection_range` over all points."""
    return _in_threads(lambda a, b: deflection_range(chain, q, w, how, gravity, out, a, b), len(q))


def compliance_threads(chain: Compact, q: Float, out: Float) -> None:
    """Threaded :func:`compliance_range` over all points."""
    _in_threads(lambda a, b: compliance_range(chain, q, out, a, b), len(q))
