"""Segments of an elastic chain as arrays, and packed for the kernels.

Rigid segments are merged, and constants sorted so that zeros cost nothing.

A *station* is a segment that is driven or elastic; what lies between is merged into fixed poses, and the masses of
merged bodies go to the station before them. A model is three arrays of records,
:mod:`counterflex.robot.elasticity.kernels.records`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.records import Record, Records, records
from counterflex.robot.elasticity.kernels.records import REGION, STATION, SURROUNDINGS, Compact
from counterflex.robot.model.controller_axes import AS_MODEL, ControllerAxes
from counterflex.robot.model.description import ComplianceCurve, Counterbalance, ElasticRegion, Opw, Play, Servo

SAME_AXIS_M = 0.1
"""Distance from an axis within which an undriven elastic segment can be its bearing."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Robot and end effector as one serial chain of n segments, packed for computing.

    ``T_base_tcp = prod_i (fixed_i Rz(sign_i q_joint_i + offset_i) E_i) T_last_tcp`` with the elastic displacement ``E``
    of :mod:`counterflex.robot.model.description`.
    """

    name: str  # name of the robot
    names: tuple[str, ...]  # n names of the segments
    fixed: Float  # (n, 4, 4) pose of each segment's frame before its drive in the previous segment
    joint: Int  # (n,) driven axis 0..5, or -1
    sign: Float  # (n,) +1 or -1
    offset: Float
    compliance: Float  # (n, 6) `tx ty tz rx ry rz` in m/N and rad/(N m), in the segment's frame; 0 is rigid
    mass: Float  # (n,) kg
    com: Float  # (n, 3) m, centre of gravity of each body in its segment's frame
    T_last_tcp: Float  # (4, 4) tool centre point in the last segment
    flange_segment: int  # index of the segment that carries the flange (-1: the base)
    T_segment_flange: Float  # (4, 4) flange in that segment
    T_flange_tcp: Float  # (4, 4) rigid pose of the TCP in the flange
    joint_limits_rad: Float  # (6, 2) lower, upper of the model's angles
    joint_speeds_rad_s: Float | None  # (6,) or None
    opw: Opw | None  # closed-form geometry or None
    counterbalance: Counterbalance | None  # or None
    gravity: Float  # (3,) m/s2 in base axes
    # play and friction of the six driven axes, None for an axis without; or None
    play: tuple[Play | None, ...] | None = None
    # loop gains of the six driven axes, None for an axis that never yields; or None
    servo: tuple[Servo | None, ...] | None = None
    # compliances that differ by region of the joint space; `compliance` is what their factors act on
    regions: tuple[ElasticRegion, ...] = ()
    # compliances that change with the load of their spring; kernels take `compliance`
    curves: tuple[ComplianceCurve, ...] = ()
    axes: ControllerAxes = AS_MODEL  # how the controller counts the axes

    @property
    def n(self) -> int:
        """Number of segments."""
        return len(self.names)

    @cached_property
    def torsion(self) -> Int:
        """(6,) index of the segment whose rotation about z is the torsion of each axis.

        The driven segment itself; where that is rigid about z, the next undriven segment of the robot that turns about
        the same axis within :data:`SAME_AXIS_M` (a bearing beside the drive's frame).
        """
        out = np.flatnonzero(self.joint >= 0)
        ends = [*out[1:], self.flange_segment + 1]
        for axis, end in enumerate(ends):
            T = np.eye(4)
            for i in range(int(out[axis]), int(end)):
                if i > out[axis]:
                    T = T @ self.fixed[i]
                if T[2, 2] < 1.0 - 1e-6 or np.hypot(T[0, 3], T[1, 3]) > SAME_AXIS_M:
                    break
                if self.compliance[i, 5] > 0.0:
                    out[axis] = i
                    break
        return frozen_int(out.tolist())


def frozen_int(values: list[int]) -> Int:
    """Whole numbers as an array that cannot be written to."""
    array = np.array(values, dtype=np.int64)
    array.flags.writeable = False
    return array


_SNAP = 1e-15  # entries of a rotation this close to 0 or +-1 are rounding of a right angle


def compact(chain: Segments) -> Compact:
    """Merge the rigid segments of a chain and sort its constants."""
    keep = [i for i in range(chain.n) if chain.joint[i] >= 0 or np.any(chain.compliance[i] > 0.0)]
    stations, surroundings = records(STATION, len(keep) + 1), records(SURROUNDINGS)
    T = np.eye(4)  # fixed pose since the last station
    row = -1
    for i in range(chain.n):
        T = T @ chain.fixed[i]
        if i in keep:
            row += 1
            if chain.joint[i] >= 0:
                c, s = np.cos(chain.offset[i]), np.sin(chain.offset[i])
                T = T @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
            _fix(T, stations[row])
            stations[row].sign = chain.sign[i]
            stations[row].compliance[:] = chain.compliance[i]
            stations[row].drive, stations[row].segment = chain.joint[i], i
            stations[row].slides = int(np.any(chain.compliance[i, :3] > 0.0))
            stations[row].rotates = int(np.any(chain.compliance[i, 3:] > 0.0))
            T = np.eye(4)
        if row >= 0 and chain.mass[i] > 0.0:  # a body before the first station rests on the base
            station = stations[row]
            p = T[:3, :3] @ chain.com[i] + T[:3, 3]
            total = station.mass + chain.mass[i]
            station.com[:] = (station.mass * station.com + chain.mass[i] * p) / total
            station.mass = total
    _fix(T @ chain.T_last_tcp, stations[-1])
    stations[-1].drive = stations[-1].segment = -1
    # Each station carries all bodies beyond it: summed once here, so that a pass adds a weight, not a loop.
    stations["carried"][:-1] = np.cumsum(stations["mass"][:-1][::-1])[::-1]
    surroundings[0].gravity[:] = chain.gravity
    if chain.counterbalance is not None:
        _balance(chain, chain.counterbalance, stations, surroundings[0])
    return Compact(stations, surroundings, _regions(chain, keep))


def _balance(chain: Segments, balance: Counterbalance, stations: Records, surroundings: Record) -> None:
    """Store a counterbalance, and its axis in the station whose torsion it acts on."""
    surroundings.anchor_column, surroundings.anchor_arm = balance.anchor_column_m, balance.anchor_arm_m
    surroundings.q_min_force, surroundings.piston_area = balance.q_min_force_rad, balance.piston_area_m2
    surroundings.gas_constant, surroundings.gas_volume_max = balance.gas_constant_j, balance.gas_volume_max_m3
    turning = int(chain.sign[np.flatnonzero(chain.joint == balance.joint)[0]]) * (balance.joint + 1)
    stations["balanced"][stations["segment"] == chain.torsion[balance.joint]] = turning


def _regions(chain: Segments, keep: list[int]) -> Records:
    """Regions of the compliance as the kernels read them."""
    out = records(REGION, len(chain.regions))
    for row, region in zip(out, chain.regions, strict=True):
        count = len(region.angles_rad)
        row.station = keep.index(chain.names.index(region.segment))
        row.direction, row.axis, row.angles_given = region.direction, region.axis, count
        row.angles[:count], row.factors[:count] = region.angles_rad, region.factors
    return out


def _fix(T: Float, station: Record) -> None:
    """Store a fixed pose, rounding noise of right angles removed, and sort it by its axis."""
    R = T[:3, :3].copy()
    R[np.abs(R) <= _SNAP] = 0.0
    one = np.abs(np.abs(R) - 1.0) <= _SNAP
    R[one] = np.sign(R[one])
    station.rotation[:] = R.ravel()
    station.position[:] = T[:3, 3]
    eye = np.eye(3)
    if np.array_equal(R, eye):
        station.turn = 0
        return
    station.turn = 4
    for axis in range(3):
        if np.array_equal(R[axis], eye[axis]) and np.array_equal(R[:, axis], eye[axis]):
            station.turn = axis + 1
