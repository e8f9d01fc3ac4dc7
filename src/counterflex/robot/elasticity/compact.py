"""The chain as the kernels read it: rigid segments merged, constants sorted so that zeros cost nothing.

A *station* is a segment that is driven or elastic; what lies between is merged into fixed poses, and the masses of
merged bodies go to the station before them. A model is two arrays,
described by the index constants of :mod:`counterflex.robot.elasticity.kernels.scalar`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.robot.elasticity.kernels.scalar import (
    BALANCE,
    BALANCED,
    CARRIED,
    COM,
    COMPLIANCE,
    DRIVE,
    GRAVITY,
    KINDS,
    MASS,
    POSITION,
    ROTATES,
    ROTATION,
    SIGN,
    SLIDES,
    TURN,
    WIDTH,
)
from counterflex.robot.elasticity.segments import Segments
from counterflex.robot.model.elastic_region import rows

_SNAP = 1e-15  # entries of a rotation this close to 0 or +-1 are rounding of a right angle


@dataclass(frozen=True, eq=False)
class Compact:
    """Arrays of a chain for the kernels.

    Attributes:
        real: (m + 2 + r, WIDTH) stations, TCP, surroundings, regions of the compliance.
        kind: (m + 1, KINDS) stations, TCP.
        segment: (m,) index of each station in the chain.
    """

    real: Float
    kind: Int
    segment: Int

    @property
    def stations(self) -> int:
        """Number of stations m."""
        return len(self.segment)


def compact(chain: Segments) -> Compact:
    """Merge the rigid segments of a chain and sort its constants."""
    keep = [i for i in range(chain.n) if chain.joint[i] >= 0 or np.any(chain.compliance[i] > 0.0)]
    m = len(keep)
    real = np.zeros((m + 2, WIDTH))
    kind = np.zeros((m + 1, KINDS), dtype=np.int64)
    T = np.eye(4)  # fixed pose since the last station
    row = -1
    for i in range(chain.n):
        T = T @ chain.fixed[i]
        if i in keep:
            row += 1
            if chain.joint[i] >= 0:
                c, s = np.cos(chain.offset[i]), np.sin(chain.offset[i])
                T = T @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
            _fixed(T, real[row], kind[row])
            real[row, SIGN] = chain.sign[i]
            real[row, COMPLIANCE : COMPLIANCE + 6] = chain.compliance[i]
            kind[row, DRIVE] = chain.joint[i]
            kind[row, SLIDES] = int(np.any(chain.compliance[i, :3] > 0.0))
            kind[row, ROTATES] = int(np.any(chain.compliance[i, 3:] > 0.0))
            T = np.eye(4)
        if row >= 0 and chain.mass[i] > 0.0:  # a body before the first station rests on the base
            p = T[:3, :3] @ chain.com[i] + T[:3, 3]
            total = real[row, MASS] + chain.mass[i]
            real[row, COM : COM + 3] = (real[row, MASS] * real[row, COM : COM + 3] + chain.mass[i] * p) / total
            real[row, MASS] = total
    _fixed(T @ chain.T_last_tcp, real[m], kind[m])
    kind[m, DRIVE] = -1
    real[:m, CARRIED] = np.cumsum(real[:m, MASS][::-1])[::-1]
    real[m + 1, GRAVITY : GRAVITY + 3] = chain.gravity
    balance = chain.counterbalance
    if balance is not None:
        real[m + 1, BALANCE : BALANCE + 6] = (
            balance.anchor_column_m,
            balance.anchor_arm_m,
            balance.q_min_force_rad,
            balance.piston_area_m2,
            balance.gas_constant_j,
            balance.gas_volume_max_m3,
        )
        turning = int(chain.sign[np.flatnonzero(chain.joint == balance.joint)[0]]) * (balance.joint + 1)
        if chain.torsion[balance.joint] in keep:
            kind[keep.index(chain.torsion[balance.joint]), BALANCED] = turning
    segment: Int = np.array(keep, dtype=np.int64)
    if chain.regions:
        real = np.vstack([real, rows(chain.regions, chain.names, segment, WIDTH)])
    return Compact(real, kind, segment)


def _fixed(T: Float, real: Float, kind: Int) -> None:
    """Store a fixed pose, rounding noise of right angles removed, and sort it by its axis."""
    R = T[:3, :3].copy()
    R[np.abs(R) <= _SNAP] = 0.0
    one = np.abs(np.abs(R) - 1.0) <= _SNAP
    R[one] = np.sign(R[one])
    real[ROTATION : ROTATION + 9] = R.ravel()
    real[POSITION : POSITION + 3] = T[:3, 3]
    eye = np.eye(3)
    if np.array_equal(R, eye):
        kind[TURN] = 0
        return
    kind[TURN] = 4
    for axis in range(3):
        if np.array_equal(R[axis], eye[axis]) and np.array_equal(R[:, axis], eye[axis]):
            kind[TURN] = axis + 1
