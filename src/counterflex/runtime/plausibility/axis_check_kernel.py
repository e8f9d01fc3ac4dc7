"""Whether axis angles and pose of the same telegram belong together: nominal kinematics against pose. Pure kernel.

The controller computes its pose from its axis angles, with its own geometry, BASE and TOOL. The same angles through the
nominal chain of the cell must give that pose, but for a frame offset that does not change. The offset is learnt while
nothing is corrected, and held from arming on.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.kernels.scalar import chain_pass, joint_trig
from counterflex.runtime.primitives.frames import all_finite, pose_deviation

# Limits, float64.
L_M: Final = 0  # m, by which a pose may differ from that of the angles
L_RAD: Final = 1
L_OFFSET_M: Final = 2  # largest frame offset
L_OFFSET_RAD: Final = 3
LIMITS: Final = 4

# What is remembered, float64.
M_OFFSET: Final = 0  # 6: pose of the telegram minus that of the angles, m and rotation vector, part axes
M_PLACE: Final = 6  # 12: pose at which it was learnt
M_Q: Final = 18  # 6: angles that agreed last
M_FOUND: Final = 24  # 2: disagreement found last, offset taken off, m and rad
REMEMBERED: Final = 26

# Whole numbers remembered.
N_LEARNT: Final = 0  # 1: there is an offset
N_NEXT: Final = 1  # next row of the trail
N_TRAIL: Final = 2  # rows of it that are filled
N_GOOD: Final = 3  # 1: there are angles that agreed
NUMBERS: Final = 4

# How a pose belongs to the angles.
ABSENT: Final = 0
EXACT: Final = 1
"""Of the same instant, from the same source."""
ABOUT: Final = 2
"""One is commanded, the other measured: they differ by what the robot trails."""

AGREE: Final = 0
DISAGREE: Final = 1
OFFSET_TOO_LARGE: Final = 2

_LEARN = 0.1
_STANDS_M = 0.1e-3


@kernel("void(float64[:, ::1], int64, int64, float64[::1])")
def _travelled(trail: Float, rows: int, last: int, out: Float) -> None:
    """How far the last pose of the trail is from any before it, the commanded or that of the angles: (2,) m and rad."""
    way = turned = 0.0
    for i in range(rows):
        for begin in (0, 12):
            p = t = 0.0
            for k in range(begin, begin + 9):
                t += (trail[last, k] - trail[i, k]) ** 2
            for k in range(begin + 9, begin + 12):
                p += (trail[last, k] - trail[i, k]) ** 2
            way, turned = max(way, p), max(turned, t)
    out[0] = math.sqrt(way)
    out[1] = 2.0 * math.asin(min(1.0, math.sqrt(turned / 8.0)))


@kernel(
    "int64(float64[::1], float64[::1], float64[::1], int64, float64[::1], int64, float64[::1], boolean,"
    " float64[:, ::1], int64[:, ::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1],"
    " float64[::1], float64[::1], int64[::1])"
)
def angles_agree(
    q: Float,
    correction: Float,
    commanded: Float,
    commanded_is: int,
    measured: Float,
    measured_is: int,
    T_part_base: Float,
    learn: bool,
    real: Float,
    kind: Int,
    limits: Float,
    trig: Float,
    frame: Float,
    trail: Float,
    work: Float,
    nothing: Float,
    memory: Float,
    counts: Int,
) -> int:
    """Hold the angles of a telegram against its poses.

    With ``D`` the pose of the telegram minus that of the angles, ``D0`` the offset, ``p`` position and ``r`` rotation::

        |p(D - D0)| <= L + |p(c)| + |p(D0)| a + |r(D0)| s + w        |r(D - D0)| <= l + |r(c)| + |r(D0)| a + u

    c is the correction that was sent: whether a controller's set angles contain it differs. a is the angle and s the
    way from the pose at which the offset was learnt: a constant error of TOOL turns with the tool, one of BASE grows
    with the way. w and u are 0; for a pose that is only ABOUT that of the angles, way and turn of the last poses that
    agreed, over the trail. Until an offset is known its largest size takes the place of L and l.

    Args:
        q: (6,) rad.
        correction: (6,) m and rotation vector.
        commanded: (12,) rotation by rows and position, part frame.
        commanded_is: EXACT, ABOUT or ABSENT.
        measured: (12,) pose that the controller reports.
        measured_is: ABSENT, EXACT or ABOUT.
        T_part_base: (12,) robot base in the part frame.
        learn: Nothing is corrected and the loop is not armed: the offset is learnt.
        real: Compact chain of the nominal robot.
        kind: Likewise.
        limits: (LIMITS,).
        trig: (12,) work space.
        frame: (m + 1, 12) work space.
        trail: (n, 24) last commanded poses and those of the angles, that agreed; changed.
        work: (5, 12) work space.
        nothing: (6,) zeros.
        memory: (REMEMBERED,); changed.
        counts: (NUMBERS,); changed.

    Returns:
        AGREE, DISAGREE, or OFFSET_TOO_LARGE: while it is learnt the offset is beyond its limit. What is not finite is
        not judged.
    """
    if not (all_finite(q, 0, 6) and all_finite(commanded, 0, 12)):
        return AGREE
    if measured_is != ABSENT and not all_finite(measured, 0, 12):
        measured_is = ABSENT
    m = kind.shape[0] - 1
    joint_trig(q, trig)
    chain_pass(real, kind, m, trig, frame, 0, frame)
    tip, own = frame[m], work[0]
    for i in range(3):
        for j in range(3):
            own[3 * i + j] = (
                T_part_base[3 * i] * tip[j] + T_part_base[3 * i + 1] * tip[3 + j] + T_part_base[3 * i + 2] * tip[6 + j]
            )
        own[9 + i] = T_part_base[9 + i] + (
            T_part_base[3 * i] * tip[9] + T_part_base[3 * i + 1] * tip[10] + T_part_base[3 * i + 2] * tip[11]
        )
    way, found, change = work[1, :2], work[2, :6], work[2, 6:12]
    offset, place = memory[M_OFFSET : M_OFFSET + 6], memory[M_PLACE : M_PLACE + 12]
    lead = work[3]
    for k in range(12):
        lead[k] = measured[k] if measured_is == EXACT else commanded[k]
    exact = measured_is == EXACT or commanded_is == EXACT
    rows = counts[N_TRAIL]
    last = (counts[N_NEXT] + trail.shape[0] - 1) % trail.shape[0]
    stands = exact
    if learn and not exact:
        _travelled(trail, rows, last, way)
        stands = way[0] < _STANDS_M
    if learn and stands:
        pose_deviation(lead, 0, own, nothing, found)
        share = _LEARN if counts[N_LEARNT] == 1 else 1.0
        for k in range(6):
            offset[k] += share * (found[k] - offset[k])
        for k in range(12):
            place[k] = lead[k]
        counts[N_LEARNT] = 1
    learnt = counts[N_LEARNT] == 1
    large_m = math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
    large_rad = math.sqrt(offset[3] ** 2 + offset[4] ** 2 + offset[5] ** 2)
    turned = gone = 0.0
    if learnt:
        for k in range(9):
            turned += (lead[k] - place[k]) ** 2
        for k in range(9, 12):
            gone += (lead[k] - place[k]) ** 2
    turned, gone = 2.0 * math.asin(min(1.0, math.sqrt(turned / 8.0))), math.sqrt(gone)
    least_m = limits[L_M] if learnt else limits[L_OFFSET_M]
    least_rad = limits[L_RAD] if learnt else limits[L_OFFSET_RAD]
    least_m += math.sqrt(correction[0] ** 2 + correction[1] ** 2 + correction[2] ** 2)
    least_rad += math.sqrt(correction[3] ** 2 + correction[4] ** 2 + correction[5] ** 2)
    least_m += large_m * turned + large_rad * gone
    least_rad += large_rad * turned
    wrong = False
    memory[M_FOUND] = memory[M_FOUND + 1] = 0.0
    for which in range(2):
        belongs, pose = (commanded_is, commanded) if which == 0 else (measured_is, measured)
        if belongs == ABSENT:
            continue
        pose_deviation(pose, 0, own, nothing, found)
        for k in range(6):
            change[k] = found[k] - offset[k]
        apart_m = math.sqrt(change[0] ** 2 + change[1] ** 2 + change[2] ** 2)
        apart_rad = math.sqrt(change[3] ** 2 + change[4] ** 2 + change[5] ** 2)
        memory[M_FOUND], memory[M_FOUND + 1] = max(memory[M_FOUND], apart_m), max(memory[M_FOUND + 1], apart_rad)
        agrees = apart_m <= least_m and apart_rad <= least_rad
        if belongs == ABOUT and not agrees:
            _travelled(trail, rows, last, way)
            agrees = apart_m <= least_m + way[0] and apart_rad <= least_rad + way[1]
        wrong = wrong or not agrees
    if learn or not wrong:  # a pose that is doubted does not widen what is allowed
        for k in range(12):
            trail[counts[N_NEXT], k] = commanded[k]
            trail[counts[N_NEXT], 12 + k] = own[k]
        counts[N_NEXT] = (counts[N_NEXT] + 1) % trail.shape[0]
        counts[N_TRAIL] = min(rows + 1, trail.shape[0])
    if learn and not (large_m <= limits[L_OFFSET_M] and large_rad <= limits[L_OFFSET_RAD]):
        return OFFSET_TOO_LARGE
    if wrong:
        return DISAGREE
    for k in range(6):
        memory[M_Q + k] = q[k]
    counts[N_GOOD] = 1
    return AGREE
