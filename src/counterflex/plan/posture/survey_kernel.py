"""Every posture at every point of a path: whether the robot can take it, and what the cut's force bends it by.

A path is divided into *edges* between *stations*. Along an edge the tool may turn, evenly, from one rotation of the
grid to the next; a deflection at a point within is weighed between the two by how far along it lies.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple

import numpy as np

from counterflex.core.arrays import Float, Float1, Float2, Float3, Float4, Int, Int2
from counterflex.core.jit import bundle, kernel
from counterflex.core.records import Record, Records
from counterflex.plan.posture.branches_kernel import ARM, SLOTS, branch_angles
from counterflex.plan.posture.deflection_kernel import deflection_along
from counterflex.robot.elasticity.kernels.records import CHAIN, Compact
from counterflex.robot.elasticity.kernels.scalar import chain_pass, joint_trig

POWER: Final = 4
"""Exponent of the deflection in the cost of a posture: between the mean square and the largest value."""
OK, OUT_OF_REACH, ARM_SINGULAR, JOINT_LIMIT, WRIST_SINGULAR = 0, 1, 2, 3, 4
"""What a posture fails by, from the arm outward."""
CODES: Final = 5
STRETCHED: Final = 0.02
"""Smallest sine of the elbow's angle, and smallest distance of the wrist from axis 1 by the length of the arm: about
1 deg, within which the angles of the arm change without bound."""


class Points(NamedTuple):
    """The path of n points, base axes."""

    p: Float2  # (n, 3) m, tool tips
    x: Float2  # (n, 3) x axis of the tool frame at rotation 0
    z: Float2  # (n, 3) its z axis, out of the spindle
    w: Float2  # (n, 6) N, N m about the tip
    normals: Float3  # (n, k, 3) directions that matter
    weight: Float1  # (n,) m, length that the point stands for; 0 where the deflection does not count
    fraction: Float1  # (n,) how far the point lies along its edge, 0 to 1
    # (1, 4, 4) flange in the tool frame where the robot carries the tool; (n, 4, 4) in that at rotation 0 where it
    # carries the part
    T_tcp_flange: Float3
    # 1 where the robot carries the part against a tool that stands. Then the part turns about the tool axis the other
    # way, load and directions with it, and the tip is a point of the part
    part_carried: int


class CandidateGrid(NamedTuple):
    """Candidates at each point, and limits of the robot."""

    arms: Annotated[Records, (ARM,)]  # (1,) ARM geometry
    cosine: Float1  # (r,) of the rotations about the tool axis
    sine: Float1  # (r,) likewise
    limits: Float2  # (6, 2) rad, with the margins taken off
    wrist: float  # smallest `|sin|` of axis 5


class Survey(NamedTuple):
    """Costs of all postures; m edges between m + 1 stations."""

    # (m, r, 8) m^(POWER + 1): sum of `weight size^POWER` as far as it belongs to the rotation at the edge's beginning;
    # infinite where the edge cannot be run there
    early: Float3
    late: Float3  # (m, r, 8) as far as it belongs to the rotation at its end
    q: Float4  # (m + 1, r, 8, 6) rad at the stations; NaN in postures that fail
    least: Float1  # (n,) m, smallest deflection at each point; infinite where no posture is possible
    failed: Int2  # (n, 5) postures by what they fail by


_POINTS = bundle(Points)
_GRID = bundle(CandidateGrid)
_SURVEY = bundle(Survey)


@kernel("int64(Arm, Grid, float64[::1])", Arm=ARM, Grid=_GRID)
def within(arm: Record, grid: CandidateGrid, q: Float) -> int:
    """Code of the limit that a posture breaks; its axes are turned into their limits where a full turn does that.

    Args:
        arm: Geometry.
        grid: Limits.
        q: (6,) rad of one branch within one turn, NaN where it does not exist; changed.
    """
    if math.isnan(q[0]):
        return OUT_OF_REACH
    two, three = arm.signs[1] * q[1] - arm.offsets[1], arm.signs[2] * q[2] - arm.offsets[2]
    bend = math.atan2(arm.a2, arm.c3)
    forearm = math.sqrt(arm.a2 * arm.a2 + arm.c3 * arm.c3)
    ahead = arm.a1 + arm.c2 * math.sin(two) + forearm * math.sin(two + three + bend)
    if abs(math.sin(three + bend)) < STRETCHED or abs(ahead) < STRETCHED * (arm.c2 + forearm):
        return ARM_SINGULAR
    for j in range(6):
        low, high = grid.limits[j, 0], grid.limits[j, 1]
        if not low <= q[j] <= high:
            if low <= q[j] - 2.0 * math.pi <= high:
                q[j] -= 2.0 * math.pi
            elif low <= q[j] + 2.0 * math.pi <= high:
                q[j] += 2.0 * math.pi
            else:
                return JOINT_LIMIT
    if abs(math.sin(arm.signs[4] * q[4] - arm.offsets[4])) < grid.wrist:
        return WRIST_SINGULAR
    return OK


@kernel("void(Grid, Points, int64, int64, float64[::1], float64[::1])", Grid=_GRID, Points=_POINTS)
def flange_at(grid: CandidateGrid, points: Points, row: int, turn: int, R: Float, wrist: Float) -> None:
    """Flange and wrist of one point at one rotation.

    ``R``: (9,) rotation of the flange in the base, written; ``wrist``: (3,) m, written.
    """
    T, c, s = points.T_tcp_flange[0], grid.cosine[turn], grid.sine[turn]
    if points.part_carried != 0:
        T, s = points.T_tcp_flange[row], -s
    x0, z, p = points.x[row], points.z[row], points.p[row]
    # right-handed about the axis from tip to spindle, -z:  x = c x0 + s (-z) x x0,  y = z x x
    vx = c * x0[0] - s * (z[1] * x0[2] - z[2] * x0[1])
    vy = c * x0[1] - s * (z[2] * x0[0] - z[0] * x0[2])
    vz = c * x0[2] - s * (z[0] * x0[1] - z[1] * x0[0])
    ux, uy, uz = z[1] * vz - z[2] * vy, z[2] * vx - z[0] * vz, z[0] * vy - z[1] * vx
    for j in range(3):
        R[j] = vx * T[0, j] + ux * T[1, j] + z[0] * T[2, j]
        R[3 + j] = vy * T[0, j] + uy * T[1, j] + z[1] * T[2, j]
        R[6 + j] = vz * T[0, j] + uz * T[1, j] + z[2] * T[2, j]
    back = grid.arms[0].c4
    wrist[0] = p[0] + vx * T[0, 3] + ux * T[1, 3] + z[0] * T[2, 3] - back * R[2]
    wrist[1] = p[1] + vy * T[0, 3] + uy * T[1, 3] + z[1] * T[2, 3] - back * R[5]
    wrist[2] = p[2] + vz * T[0, 3] + uz * T[1, 3] + z[2] * T[2, 3] - back * R[8]


@kernel("void(float64[::1], float64[::1], float64, float64, float64[::1])")
def turned_about(v: Float, z: Float, c: float, s: float, out: Float) -> None:
    """Turn a vector about the axis from tip to spindle, -z, by an angle of cosine c and sine s."""
    along = v[0] * z[0] + v[1] * z[1] + v[2] * z[2]
    out[0] = c * v[0] - s * (z[1] * v[2] - z[2] * v[1]) + (1.0 - c) * along * z[0]
    out[1] = c * v[1] - s * (z[2] * v[0] - z[0] * v[2]) + (1.0 - c) * along * z[1]
    out[2] = c * v[2] - s * (z[0] * v[1] - z[1] * v[0]) + (1.0 - c) * along * z[2]


@kernel(
    "void(Chain, Grid, Points, int64[::1], Survey, int64, int64)",
    waits=True,
    Chain=CHAIN,
    Grid=_GRID,
    Points=_POINTS,
    Survey=_SURVEY,
    entry=True,
)
def survey_edges(
    chain: Compact, grid: CandidateGrid, points: Points, stations: Int, survey: Survey, first: int, last: int
) -> None:
    """Try every posture at every point of the edges first..last-1.

    Args:
        chain: Elastic chain.
        grid: What is tried.
        stations: (m + 1,) rows of the stations, rising, the first 0 and the last n - 1.
        survey: Results, written; ``early`` and ``late`` are added to.
        first: First edge.
        last: One behind the last.
    """
    m = len(chain.stations) - 1
    frame, delta, trig = np.empty((m + 1, 12)), np.zeros((m, 6)), np.empty(12)
    R, wrist, q = np.empty(9), np.empty(3), np.empty((SLOTS, 6))
    arm = grid.arms[0]
    carried, count = points.part_carried != 0, points.normals.shape[1]
    w, normals = np.empty(6), np.empty((count, 3))
    for e in range(first, last):
        begin = 0 if e == 0 else stations[e] + 1
        for row in range(begin, stations[e + 1] + 1):
            weight, fraction = points.weight[row], points.fraction[row]
            station = e + 1 if row == stations[e + 1] else (0 if row == 0 else -1)
            least = math.inf
            for turn in range(len(grid.cosine)):
                flange_at(grid, points, row, turn, R, wrist)
                w[:] = points.w[row]
                normals[:] = points.normals[row]
                if carried and weight > 0.0:
                    z, c, s = points.z[row], grid.cosine[turn], -grid.sine[turn]
                    turned_about(points.w[row, :3], z, c, s, w[:3])
                    turned_about(points.w[row, 3:], z, c, s, w[3:])
                    for k in range(count):
                        turned_about(points.normals[row, k], z, c, s, normals[k])
                branch_angles(grid.arms, R, wrist, q)
                for slot in range(SLOTS):
                    fault = within(arm, grid, q[slot])
                    survey.failed[row, fault] += 1
                    if station >= 0:
                        for j in range(6):
                            survey.q[station, turn, slot, j] = q[slot, j] if fault == OK else np.nan
                    if fault != OK:
                        if row > 0 and fraction < 1.0:
                            survey.early[e, turn, slot] = math.inf
                        if row > 0:
                            survey.late[e, turn, slot] = math.inf
                        continue
                    if weight == 0.0:
                        least = 0.0
                        continue
                    joint_trig(q[slot], trig)
                    chain_pass(chain, trig, delta, 0, frame)
                    if carried:
                        frame[m, 9:12] = points.p[row]
                    square = 0.0
                    for k in range(count):
                        along = deflection_along(chain, frame, q[slot], w, normals[k])
                        square += along * along
                    least = min(least, math.sqrt(square))
                    cost = weight * square * square
                    survey.early[e, turn, slot] += (1.0 - fraction) * cost
                    survey.late[e, turn, slot] += fraction * cost
            survey.least[row] = least
