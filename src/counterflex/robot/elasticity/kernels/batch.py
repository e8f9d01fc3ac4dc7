"""Batches of the scalar kernels: a serial loop over a range of points, and the same threaded.

Inputs are (n, 6) C-ordered and writable; ``out`` arrays are filled in place. The threaded forms must not be called from
the online process. Their threads are Python's: Numba's own parallel loops are compiled twice as long.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel, thread_count
from counterflex.robot.elasticity.kernels.equilibrium import settle
from counterflex.robot.elasticity.kernels.records import CHAIN, STEP, WORK, Compact, Elastic
from counterflex.robot.elasticity.kernels.scalar import (
    chain_pass,
    joint_trig,
    loads,
    pose_difference,
    rigid_jacobian,
    tcp_compliance,
)
from counterflex.robot.elasticity.kernels.step import step

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


@kernel(
    "void(Chain, float64[:, ::1], float64[:, ::1], int64, float64[:, ::1], int64[::1], int64, int64)",
    waits=True,
    Chain=CHAIN,
    entry=True,
)
def step_range(
    chain: Compact, q: Float, w: Float, gravity: int, out: Float, status: Int, first: int, last: int
) -> None:
    """Steps for the points first..last-1: ``out`` (n, 19) = deflection, q_c, residual, sigma."""
    m = len(chain.stations) - 1
    elastic = Elastic(chain, np.empty(1, STEP), np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(1, WORK))
    inputs, result = np.empty(12), elastic.results[0]
    for n in range(first, last):
        for k in range(6):
            inputs[k] = q[n, k]
            inputs[6 + k] = w[n, k]
        status[n] = step(elastic, inputs, gravity)
        for k in range(6):
            out[n, k] = result.deflection[k]
            out[n, 6 + k] = result.q[k]
            out[n, 12 + k] = result.residual[k]
        out[n, 18] = result.sigma


@functools.cache
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count, thread_name_prefix="batch")


def _in_threads(work: Callable[[int, int], int | None], count: int) -> int:
    """Do a range of points in several threads, some chunks each; a compiled range lets other threads run meanwhile.

    Args:
        work: Does the points first..last-1, and may give a number.
        count: Of points.

    Returns:
        Sum of these numbers.
    """
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


def step_threads(chain: Compact, q: Float, w: Float, gravity: int, out: Float, status: Int) -> None:
    """Threaded :func:`step_range` over all points."""
    _in_threads(lambda a, b: step_range(chain, q, w, gravity, out, status, a, b), len(q))
