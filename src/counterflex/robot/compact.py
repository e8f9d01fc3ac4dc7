"""The chain as the kernels read it: rigid segments merged, constants sorted so that zeros cost nothing.

A *station* is a segment that is driven or elastic; what lies between is merged into fixed poses, and the masses of
merged bodies go to the station before them. A model is two arrays, described by the index constants below.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from counterflex.core.arrays import Float, Int

if TYPE_CHECKING:
    from counterflex.robot.chain import ElasticChain

# Columns of ``real`` (one row per station, then one row for the TCP, then one row for the surroundings).
ROTATION: Final = 0  # 9 entries, row by row: fixed rotation, the drive's offset included
POSITION: Final = 9  # 3 entries, m
SIGN: Final = 12  # of the drive
COMPLIANCE: Final = 13  # 6 entries
MASS: Final = 19  # kg, of the bodies that ride on this station
COM: Final = 20  # 3 entries, m, of those bodies in the station's frame
CARRIED: Final = 23  # kg, this station and all beyond
WIDTH: Final = 24

# Entries of the row for the surroundings.
GRAVITY: Final = 0  # 3 entries, m/s2
BALANCE: Final = 3  # D, k, q_min_force, A, Z R T m, V_max

# Columns of ``kind``.
TURN: Final = 0  # fixed rotation: 0 none, 1 about x, 2 about y, 3 about z, 4 general
DRIVE: Final = 1  # joint 0..5 or -1
ROTATES: Final = 2  # 1 where the element has rotational compliance
SLIDES: Final = 3  # 1 where it has translational compliance
BALANCED: Final = 4  # 1 where the counterbalance acts on this drive
KINDS: Final = 5

_SNAP = 1e-15  # entries of a rotation this close to 0 or +-1 are rounding of a right angle


@dataclass(frozen=True, eq=False)
class Compact:
    """Arrays of a chain for the kernels.

    Attributes:
        real: (m + 2, WIDTH) stations, TCP, surroundings.
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


def compact(chain: ElasticChain) -> Compact:
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
        kind[:m, BALANCED] = kind[:m, DRIVE] == balance.joint
    segment: Int = np.array(keep, dtype=np.int64)
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
