"""Check that axis angles and pose of the same telegram belong together: nominal kinematics against pose. Pure kernel.

The controller computes its pose from its axis angles, with its own geometry, BASE and TOOL. The same angles through the
nominal chain of the cell must give that pose, but for a frame offset that does not change. The offset is learnt while
nothing is corrected, and held from arming on.
"""

from __future__ import annotations

import math
from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, matrix, to_pointer
from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record
from counterflex.robot.elasticity.kernels.records import REGION, STATION, SURROUNDINGS, Compact
from counterflex.robot.elasticity.kernels.scalar import chain_pass, joint_trig
from counterflex.runtime.primitives.frames import all_finite, pose_deviation
from counterflex.runtime.state.states import Cause

CHECK: Final = record(
    T_part_base=(float, 12),  # robot base in the part frame, rotation by rows and position
    T_base_tcp=(float, 12),  # tool frame of a spindle that stands, likewise
    holds_part=int,  # 1: the robot holds the part: the angles place it, not the tool
    limit_m=float,  # by which a pose may differ from that of the angles
    limit_rad=float,
    offset_limit_m=float,  # largest frame offset
    offset_limit_rad=float,
    # Remembered.
    offset=(float, 6),  # pose of the telegram minus that of the angles, m and rotation vector, part axes
    place=(float, 12),  # pose at which it was learnt
    angles=(float, 6),  # that agreed last
    distance_m=float,  # disagreement found last, offset taken off
    angle_rad=float,
    learnt=int,  # 1: there is an offset
    trail_next=int,  # next row of the trail
    trail_rows=int,  # rows of it that are filled
    good=int,  # 1: there are angles that agreed
    # Of this telegram alone.
    own=(float, 12),  # pose of the angles, part frame
    lead=(float, 12),  # pose that is the better one for the offset
    found=(float, 6),  # pose of the telegram minus that of the angles
    way_m=float,  # way and turn of the last poses that agreed, over the trail
    way_rad=float,
    trig=(float, 12),
    nothing=(float, 6),  # zeros
)
"""Limits and memory of the check of axis angles."""

TRAIL: Final = record(commanded=(float, 12), own=(float, 12))
"""Poses that agreed: commanded and that of the angles."""

ARRAYS: Final = addresses("stations", "surroundings", "regions", "frame", "trail", "checks")

# How a pose belongs to the angles.
ABSENT: Final = 0
EXACT: Final = 1
"""Of the same instant, from the same source."""
ABOUT: Final = 2
"""One is commanded, the other measured: they differ by what the robot trails."""

AGREE: Final = 0
DISAGREE: Final = int(Cause.AXIS_ANGLES)
OFFSET_TOO_LARGE: Final = int(Cause.FRAME_OFFSET)

_LEARN = 0.1
_STANDS_M = 0.1e-3


@kernel("float64(float64[::1], int64)")
def _length(x: Float, begin: int) -> float:
    """Length of the vector ``x[begin : begin + 3]``."""
    return math.sqrt(x[begin] ** 2 + x[begin + 1] ** 2 + x[begin + 2] ** 2)


@kernel("UniTuple(float64, 2)(float64[::1], float64[::1])")
def _square_distance(a: Float, b: Float) -> tuple[float, float]:
    """Squared differences of two poses: of the positions, and of the rotation matrices."""
    p = t = 0.0
    for k in range(9):
        t += (a[k] - b[k]) ** 2
    for k in range(9, 12):
        p += (a[k] - b[k]) ** 2
    return p, t


@kernel("float64(float64)")
def _angle(square: float) -> float:
    """Angle of a rotation whose matrix differs by this square from the unit matrix: ``|R - I|^2 = 8 sin^2(a / 2)``."""
    return 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))


@kernel("void(Check, Trail[::1])", Check=CHECK, Trail=TRAIL)
def _travelled(c: Record, trail: Records) -> None:
    """Largest distance of the trail's last pose from any before it, commanded or of the angles; way and turn."""
    last = trail[(c.trail_next + trail.shape[0] - 1) % trail.shape[0]]
    way = turned = 0.0
    for i in range(c.trail_rows):
        p, t = _square_distance(last.commanded[:], trail[i].commanded[:])
        way, turned = max(way, p), max(turned, t)
        p, t = _square_distance(last.own[:], trail[i].own[:])
        way, turned = max(way, p), max(turned, t)
    c.way_m, c.way_rad = math.sqrt(way), _angle(turned)


@kernel("void(Check, float64[::1])", Check=CHECK)
def _place_in_part(c: Record, tip: Float) -> None:
    """Pose of the tool in the part frame from that of the hand (12,), base frame: into ``own``."""
    # The robot holds the part: the tool stands in base axes, and its pose seen from the part is ``T_hand^-1 T_tool``.
    if c.holds_part == 1:
        tool = c.T_base_tcp
        for i in range(3):
            for j in range(3):
                c.own[3 * i + j] = tip[i] * tool[j] + tip[3 + i] * tool[3 + j] + tip[6 + i] * tool[6 + j]
            x, y, z = tool[9] - tip[9], tool[10] - tip[10], tool[11] - tip[11]
            c.own[9 + i] = tip[i] * x + tip[3 + i] * y + tip[6 + i] * z
        return
    for i in range(3):
        a, b, d = c.T_part_base[3 * i], c.T_part_base[3 * i + 1], c.T_part_base[3 * i + 2]
        for j in range(3):
            c.own[3 * i + j] = a * tip[j] + b * tip[3 + j] + d * tip[6 + j]
        c.own[9 + i] = c.T_part_base[9 + i] + (a * tip[9] + b * tip[10] + d * tip[11])


@kernel("void(Check, Trail[::1], boolean)", Check=CHECK, Trail=TRAIL)
def _learn_offset(c: Record, trail: Records, exact: bool) -> None:
    """Learn the offset from a pose of the angles' own instant, or while the robot stands."""
    stands = exact
    if not exact:
        _travelled(c, trail)
        stands = c.way_m < _STANDS_M
    if not stands:
        return
    pose_deviation(c.lead[:], 0, c.own[:], c.nothing[:], c.found[:])
    # The first pose counts whole: from zero the mean would start with an offset that is nobody's.
    share = _LEARN if c.learnt == 1 else 1.0
    for k in range(6):
        c.offset[k] += share * (c.found[k] - c.offset[k])
    for k in range(12):
        c.place[k] = c.lead[k]
    c.learnt = 1


@kernel("UniTuple(float64, 2)(Check, float64[::1])", Check=CHECK)
def _allowed(c: Record, correction: Float) -> tuple[float, float]:
    """By how much a pose may be off that of the angles, m and rad, what the robot trails apart."""
    large_m, large_rad = _length(c.offset[:], 0), _length(c.offset[:], 3)
    way = turned = 0.0
    if c.learnt == 1:
        way, turned = _square_distance(c.lead[:], c.place[:])
    turned, way = _angle(turned), math.sqrt(way)
    # An offset in which TOOL is wrong turns with the tool, one in which BASE is wrong grows with the way: either shows
    # only behind the place where it was learnt, so both widen the bound by what they can have become.
    least_m = c.limit_m if c.learnt == 1 else c.offset_limit_m
    least_rad = c.limit_rad if c.learnt == 1 else c.offset_limit_rad
    least_m += _length(correction, 0)
    least_rad += _length(correction, 3)
    least_m += large_m * turned + large_rad * way
    least_rad += large_rad * turned
    return least_m, least_rad


@kernel("boolean(Check, Trail[::1], float64[::1], int64, float64, float64)", Check=CHECK, Trail=TRAIL)
def _agrees(c: Record, trail: Records, pose: Float, belongs: int, least_m: float, least_rad: float) -> bool:
    """Return whether one pose of the telegram is that of the angles; the largest disagreement is remembered."""
    if belongs == ABSENT:
        return True
    pose_deviation(pose, 0, c.own[:], c.nothing[:], c.found[:])
    for k in range(6):
        c.found[k] -= c.offset[k]
    distance_m, angle_rad = _length(c.found[:], 0), _length(c.found[:], 3)
    c.distance_m, c.angle_rad = max(c.distance_m, distance_m), max(c.angle_rad, angle_rad)
    agrees = distance_m <= least_m and angle_rad <= least_rad
    if belongs == ABOUT and not agrees:
        _travelled(c, trail)
        agrees = distance_m <= least_m + c.way_m and angle_rad <= least_rad + c.way_rad
    return bool(agrees)


@kernel("void(Check, Trail[::1], float64[::1])", Check=CHECK, Trail=TRAIL)
def _follow(c: Record, trail: Records, commanded: Float) -> None:
    """Take the poses of this telegram into the trail."""
    row = trail[c.trail_next]
    for k in range(12):
        row.commanded[k], row.own[k] = commanded[k], c.own[k]
    c.trail_next = (c.trail_next + 1) % trail.shape[0]
    c.trail_rows = min(c.trail_rows + 1, trail.shape[0])


@kernel(
    "int64(Arrays[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64, int64, int64)",
    Arrays=ARRAYS,
    entry=True,
)
def angles_agree(
    tables: Records,
    q: Float,
    correction: Float,
    commanded: Float,
    measured: Float,
    commanded_is: int,
    measured_is: int,
    learn: int,
) -> int:
    """Hold the angles of a telegram against its poses.

    With ``D`` the pose of the telegram minus that of the angles, ``D0`` the offset, ``p`` position and ``r`` rotation::

        |p(D - D0)| <= L + |p(c)| + |p(D0)| a + |r(D0)| s + w        |r(D - D0)| <= l + |r(c)| + |r(D0)| a + u

    c is the correction that was sent: whether a controller's set angles contain it differs. a is the angle and s the
    way from the pose at which the offset was learnt: a constant error of TOOL turns with the tool, one of BASE grows
    with the way. w and u are 0; for a pose that is only ABOUT that of the angles, way and turn of the last poses that
    agreed, over the trail. Until an offset is known its largest size takes the place of L and l.

    Args:
        tables: (1,) ARRAYS: compact chain of the nominal robot, (m + 1, 12) work space, TRAIL and CHECK; changed.
        q: (6,) rad; those that do not agree are replaced by the last that did.
        correction: (6,) m and rotation vector.
        commanded: (12,) rotation by rows and position, part frame.
        measured: (12,) pose that the controller reports.
        commanded_is: EXACT, ABOUT or ABSENT: how it belongs to the angles.
        measured_is: Likewise.
        learn: 1: nothing is corrected and the loop is not armed: the offset is learnt.

    Returns:
        Cause of a hold: AGREE is 0, DISAGREE, or OFFSET_TOO_LARGE: while it is learnt the offset is beyond its limit.
        What is not finite is not judged.
    """
    table = tables[0]
    c = carray(to_pointer(table.checks.place), (1,), CHECK)[0]
    # Not judged here, since the step faults on it as NOT_FINITE: one cause for one telegram.
    if not (all_finite(q) and all_finite(commanded)):
        return AGREE
    trail, frame = carray(to_pointer(table.trail.place), (table.trail.rows,), TRAIL), matrix(table.frame)
    stations, surroundings, regions = table.stations, table.surroundings, table.regions
    chain = Compact(
        carray(to_pointer(stations.place), (stations.rows,), STATION),
        carray(to_pointer(surroundings.place), (1,), SURROUNDINGS),
        carray(to_pointer(regions.place), (regions.rows,), REGION),
    )
    if measured_is != ABSENT and not all_finite(measured):
        measured_is = ABSENT
    joint_trig(q, c.trig[:])
    chain_pass(chain, c.trig[:], frame, 0, frame)
    _place_in_part(c, frame[len(chain.stations) - 1])
    for k in range(12):
        c.lead[k] = measured[k] if measured_is == EXACT else commanded[k]
    if learn == 1:
        _learn_offset(c, trail, measured_is == EXACT or commanded_is == EXACT)
    least_m, least_rad = _allowed(c, correction)
    c.distance_m = c.angle_rad = 0.0
    agreed = _agrees(c, trail, commanded, commanded_is, least_m, least_rad)
    agreed = _agrees(c, trail, measured, measured_is, least_m, least_rad) and agreed
    if learn == 1 or agreed:  # a pose that is doubted does not widen what is allowed
        _follow(c, trail, commanded)
    if learn == 1 and not (
        _length(c.offset[:], 0) <= c.offset_limit_m and _length(c.offset[:], 3) <= c.offset_limit_rad
    ):
        return OFFSET_TOO_LARGE
    if not agreed:
        # The Jacobian of a doubted pose could turn the correction round; that of the pose before differs by a cycle's
        # way.
        if c.good == 1:
            q[:] = c.angles
        return DISAGREE
    for k in range(6):
        c.angles[k] = q[k]
    c.good = 1
    return AGREE
