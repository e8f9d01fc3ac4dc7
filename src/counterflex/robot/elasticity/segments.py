"""Segments of an elastic chain as arrays: :mod:`.chain` uses them, :mod:`.compact` packs them for the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.robot.model.description import Counterbalance, ElasticRegion, Opw, Play, Servo

SAME_AXIS_M = 0.1
"""Distance from an axis within which an undriven elastic segment can be its bearing."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Robot and end effector as one serial chain of n segments, packed for computing.

    ``T_base_tcp = prod_i (fixed_i Rz(sign_i q_joint_i + offset_i) E_i) T_last_tcp`` with the elastic displacement ``E``
    of :mod:`counterflex.robot.model.description`.

    Attributes:
        name: Name of the robot.
        names: n names of the segments.
        fixed: (n, 4, 4) pose of each segment's frame before its drive in the previous segment.
        joint: (n,) driven axis 0..5, or -1.
        sign: (n,) +1 or -1.
        offset: (n,) rad.
        compliance: (n, 6) ``tx ty tz rx ry rz`` in m/N and rad/(N m), in the segment's frame; 0 is rigid.
        mass: (n,) kg.
        com: (n, 3) m, centre of gravity of each body in its segment's frame.
        T_last_tcp: (4, 4) tool centre point in the last segment.
        flange_segment: Index of the segment that carries the flange (-1: the base).
        T_segment_flange: (4, 4) flange in that segment.
        T_flange_tcp: (4, 4) rigid pose of the TCP in the flange.
        joint_limits_rad: (6, 2) lower, upper.
        joint_speeds_rad_s: (6,) or None.
        opw: Closed-form geometry or None.
        counterbalance: Or None.
        gravity: (3,) m/s2 in base axes.
        play: Play and friction of the six driven axes, None for an axis without; or None.
        servo: Loop gains of the six driven axes, None for an axis that never yields; or None.
        regions: Compliances that differ by region of the joint space; ``compliance`` is what their factors act on.
    """

    name: str
    names: tuple[str, ...]
    fixed: Float
    joint: Int
    sign: Float
    offset: Float
    compliance: Float
    mass: Float
    com: Float
    T_last_tcp: Float
    flange_segment: int
    T_segment_flange: Float
    T_flange_tcp: Float
    joint_limits_rad: Float
    joint_speeds_rad_s: Float | None
    opw: Opw | None
    counterbalance: Counterbalance | None
    gravity: Float
    play: tuple[Play | None, ...] | None = None
    servo: tuple[Servo | None, ...] | None = None
    regions: tuple[ElasticRegion, ...] = ()

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
