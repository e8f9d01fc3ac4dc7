"""All eight closed-form solutions of a pose in one compiled call.

The library behind :func:`counterflex.robot.model.opw.branches` takes 12 us a pose; a posture is chosen from millions of
them. The equations are those of Brandstoetter, Angerer, Hofbaur 2014, slots in the order of
:data:`counterflex.robot.model.opw.BRANCHES`; the tests hold the two to each other.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Records, record, records
from counterflex.robot.model.description import Opw

SLOTS: Final = 8
ARM: Final = record(
    a1=float, a2=float, b=float, c1=float, c2=float, c3=float, c4=float, offsets=(float, 6), signs=(float, 6)
)
"""Geometry of :class:`counterflex.robot.model.description.Opw`: m, rad."""


def arm_record(opw: Opw) -> Records:
    """(1,) ARM of a geometry."""
    out = records(ARM)
    arm = out[0]
    arm.a1, arm.a2, arm.b = opw.a1_m, opw.a2_m, opw.b_m
    arm.c1, arm.c2, arm.c3, arm.c4 = opw.c1_m, opw.c2_m, opw.c3_m, opw.c4_m
    arm.offsets[:], arm.signs[:] = opw.offsets_rad, opw.signs
    return out


@kernel("void(Arm[::1], float64[::1], float64[::1], float64[:, ::1])", Arm=ARM)
def branch_angles(arms: Records, R: Float, wrist: Float, out: Float) -> None:
    """Controller angles of all branches, joint limits ignored.

    Args:
        arms: (1,) ARM.
        R: (9,) rotation of the flange in the base, by rows.
        wrist: (3,) m, centre of the wrist in the base.
        out: (8, 6) rad, written: within one turn (-pi, pi]; NaN in the rows that do not exist.
    """
    arm = arms[0]
    cx, cy, cz = wrist[0], wrist[1], wrist[2]
    b2 = arm.b * arm.b
    ahead = cx * cx + cy * cy - b2
    if ahead < 0.0:
        out[:, :] = np.nan
        return
    front = math.sqrt(ahead) - arm.a1
    back = front + 2.0 * arm.a1
    up = cz - arm.c1
    k2 = arm.a2 * arm.a2 + arm.c3 * arm.c3
    k = math.sqrt(k2)
    c2 = arm.c2
    heading, aside = math.atan2(cy, cx), math.atan2(arm.b, front + arm.a1)
    bend = math.atan2(arm.a2, arm.c3)
    for side in range(2):
        x = front if side == 0 else -back
        s2 = x * x + up * up
        s = math.sqrt(s2)
        lift = (s2 + c2 * c2 - k2) / (2.0 * s * c2)
        fold = (s2 - c2 * c2 - k2) / (2.0 * c2 * k)
        if abs(lift) > 1.0 or abs(fold) > 1.0 or s == 0.0:
            for row in range(2):
                for j in range(6):
                    out[2 * side + row, j] = np.nan
                    out[4 + 2 * side + row, j] = np.nan
            continue
        one = heading - aside if side == 0 else heading + aside - math.pi
        c_one, s_one = math.cos(one), math.sin(one)
        raised, tilted, folded = math.acos(lift), math.atan2(x, up), math.acos(fold)
        for row in range(2):
            sign = 1.0 if row == 0 else -1.0
            two, three = tilted - sign * raised, sign * folded - bend
            c, t = math.cos(two + three), math.sin(two + three)
            # axes of the flange in the forearm: x = forward, y = left, z = along
            zx = R[2] * c * c_one + R[5] * c * s_one - R[8] * t
            zy = R[5] * c_one - R[2] * s_one
            zz = R[2] * t * c_one + R[5] * t * s_one + R[8] * c
            xz = R[0] * t * c_one + R[3] * t * s_one + R[6] * c
            yz = R[1] * t * c_one + R[4] * t * s_one + R[7] * c
            four = math.atan2(zy, zx)
            five = math.atan2(math.sqrt(zx * zx + zy * zy), zz)
            six = math.atan2(yz, -xz)
            for flip in range(2):
                slot = 4 * flip + 2 * side + row
                out[slot, 0], out[slot, 1], out[slot, 2] = one, two, three
                out[slot, 3] = four if flip == 0 else four + math.pi
                out[slot, 4] = five if flip == 0 else -five
                out[slot, 5] = six if flip == 0 else six - math.pi
                for j in range(6):
                    q = arm.signs[j] * (out[slot, j] + arm.offsets[j])
                    out[slot, j] = q - 2.0 * math.pi * math.floor(q / (2.0 * math.pi) + 0.5)
