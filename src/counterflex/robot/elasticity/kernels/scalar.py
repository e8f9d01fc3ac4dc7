"""Scalar kernels of the elastic chain: one point at a time, generic in the chain, no allocation.

Chain and work arrays are those of :mod:`counterflex.robot.elasticity.kernels.records`.
"""

from __future__ import annotations

import math
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.robot.elasticity.kernels.records import CHAIN, REGION, SURROUNDINGS, Compact

# Scalar kernels of compliances that differ by region of the joint space.
# Regions are records, :data:`counterflex.robot.elasticity.kernels.records.REGION`. What they mean says
# :mod:`counterflex.robot.model.elastic_region`.

FADE: Final = math.radians(10.0)
"""Equals :data:`counterflex.robot.model.elastic_region.FADE_RAD`."""


@kernel("float64(Region, float64)", Region=REGION)
def factor_at(region: Record, angle: float) -> float:
    """Factor of one region at the angle of its axis: linear between its angles, fading to 1 beyond them."""
    angles, factors = region.angles[:], region.factors[:]
    last = region.angles_given - 1
    low: float = angles[0]
    high: float = angles[last]
    if angle <= low:
        first: float = factors[0]
        return 1.0 + (first - 1.0) * max(0.0, 1.0 - (low - angle) / FADE)
    if angle >= high:
        end: float = factors[last]
        return 1.0 + (end - 1.0) * max(0.0, 1.0 - (angle - high) / FADE)
    k = 0
    while angle > angles[k + 1]:
        k += 1
    a: float = angles[k]
    share = (angle - a) / (angles[k + 1] - a)
    out: float = factors[k] + share * (factors[k + 1] - factors[k])
    return out


@kernel("float64(Region[::1], int64, int64, float64[::1])", Region=REGION)
def growth_at(regions: Records, station: int, direction: int, q: Float) -> float:
    """Factor of all regions together on one spring."""
    out = 1.0
    for r in range(len(regions)):
        region = regions[r]
        if region.station == station and region.direction == direction:
            out *= factor_at(region, q[region.axis])
    return out


@kernel("void(Region[::1], float64[::1], float64[:, ::1])", Region=REGION)
def grow(regions: Records, q: Float, delta: Float) -> None:
    """Multiply elastic displacements (m, 6) by the factors of the regions at the angles q (6,) rad."""
    for r in range(len(regions)):
        region = regions[r]
        delta[region.station, region.direction] *= factor_at(region, q[region.axis])


SMALL: Final = 0.1  # rad; below this the series are exact to double precision


@kernel(inline=True)
def small_sin(a: float) -> float:
    """Sine of an angle within +-SMALL."""
    b = a * a
    return a * (1.0 + b * (-1.0 / 6.0 + b * (1.0 / 120.0 + b * (-1.0 / 5040.0 + b * (1.0 / 362880.0)))))


@kernel(inline=True)
def small_cos(a: float) -> float:
    """Cosine of an angle within +-SMALL."""
    b = a * a
    return 1.0 + b * (-0.5 + b * (1.0 / 24.0 + b * (-1.0 / 720.0 + b * (1.0 / 40320.0 + b * (-1.0 / 3628800.0)))))


@kernel(inline=True)
def small_asin_ratio(b: float) -> float:
    """``asin(s) / s`` for ``b = s^2`` with s <= SMALL."""
    return 1.0 + b * (
        1.0 / 6.0
        + b * (3.0 / 40.0 + b * (5.0 / 112.0 + b * (35.0 / 1152.0 + b * (63.0 / 2816.0 + b * (231.0 / 13312.0)))))
    )


@kernel("void(float64[::1], float64[::1])")
def joint_trig(q: Float, trig: Float) -> None:
    """Cosines and sines of the joint angles."""
    for j in range(6):
        trig[j] = math.cos(q[j])
        trig[6 + j] = math.sin(q[j])


@kernel("void(Chain, float64[::1], float64[:, ::1], int64, float64[:, ::1])", Chain=CHAIN)
def chain_pass(chain: Compact, trig: Float, delta: Float, elastic: int, frame: Float) -> None:
    """Pose of every station after its drive, and of the TCP.

    With ``elastic`` every station is displaced by its row of ``delta`` (m, 6): translation, then z-y'-x'' rotations.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    x, y, z = 0.0, 0.0, 0.0
    m = len(chain.stations) - 1
    for i in range(m + 1):
        station = chain.stations[i]
        a, b, c = station.position[0], station.position[1], station.position[2]
        x += r00 * a + r01 * b + r02 * c
        y += r10 * a + r11 * b + r12 * c
        z += r20 * a + r21 * b + r22 * c
        turn = station.turn
        if turn == 1:
            c, s = station.rotation[4], station.rotation[7]
            r01, r02 = c * r01 + s * r02, c * r02 - s * r01
            r11, r12 = c * r11 + s * r12, c * r12 - s * r11
            r21, r22 = c * r21 + s * r22, c * r22 - s * r21
        elif turn == 2:
            c, s = station.rotation[0], station.rotation[2]
            r00, r02 = c * r00 - s * r02, c * r02 + s * r00
            r10, r12 = c * r10 - s * r12, c * r12 + s * r10
            r20, r22 = c * r20 - s * r22, c * r22 + s * r20
        elif turn == 3:
            c, s = station.rotation[0], station.rotation[3]
            r00, r01 = c * r00 + s * r01, c * r01 - s * r00
            r10, r11 = c * r10 + s * r11, c * r11 - s * r10
            r20, r21 = c * r20 + s * r21, c * r21 - s * r20
        elif turn == 4:
            f = station.rotation[:]
            r00, r01, r02 = (
                r00 * f[0] + r01 * f[3] + r02 * f[6],
                r00 * f[1] + r01 * f[4] + r02 * f[7],
                r00 * f[2] + r01 * f[5] + r02 * f[8],
            )
            r10, r11, r12 = (
                r10 * f[0] + r11 * f[3] + r12 * f[6],
                r10 * f[1] + r11 * f[4] + r12 * f[7],
                r10 * f[2] + r11 * f[5] + r12 * f[8],
            )
            r20, r21, r22 = (
                r20 * f[0] + r21 * f[3] + r22 * f[6],
                r20 * f[1] + r21 * f[4] + r22 * f[7],
                r20 * f[2] + r21 * f[5] + r22 * f[8],
            )
        joint = station.drive
        if joint >= 0:
            c, s = trig[joint], station.sign * trig[6 + joint]
            r00, r01 = c * r00 + s * r01, c * r01 - s * r00
            r10, r11 = c * r10 + s * r11, c * r11 - s * r10
            r20, r21 = c * r20 + s * r21, c * r21 - s * r20
        out = frame[i]
        out[0], out[1], out[2] = r00, r01, r02
        out[3], out[4], out[5] = r10, r11, r12
        out[6], out[7], out[8] = r20, r21, r22
        out[9], out[10], out[11] = x, y, z
        if elastic == 0 or i == m:
            continue
        if station.slides != 0:
            a, b, c = delta[i, 0], delta[i, 1], delta[i, 2]
            x += r00 * a + r01 * b + r02 * c
            y += r10 * a + r11 * b + r12 * c
            z += r20 * a + r21 * b + r22 * c
        if station.rotates != 0:
            a, b, c = delta[i, 3], delta[i, 4], delta[i, 5]
            if abs(a) + abs(b) + abs(c) <= SMALL:
                ca, sa, cb, sb, cc, sc = (
                    small_cos(a), small_sin(a), small_cos(b), small_sin(b), small_cos(c), small_sin(c),
                )  # fmt: skip
            else:
                ca, sa, cb, sb, cc, sc = math.cos(a), math.sin(a), math.cos(b), math.sin(b), math.cos(c), math.sin(c)
            r00, r01 = cc * r00 + sc * r01, cc * r01 - sc * r00
            r10, r11 = cc * r10 + sc * r11, cc * r11 - sc * r10
            r20, r21 = cc * r20 + sc * r21, cc * r21 - sc * r20
            r00, r02 = cb * r00 - sb * r02, cb * r02 + sb * r00
            r10, r12 = cb * r10 - sb * r12, cb * r12 + sb * r10
            r20, r22 = cb * r20 - sb * r22, cb * r22 + sb * r20
            r01, r02 = ca * r01 + sa * r02, ca * r02 - sa * r01
            r11, r12 = ca * r11 + sa * r12, ca * r12 - sa * r11
            r21, r22 = ca * r21 + sa * r22, ca * r22 - sa * r21


@kernel("float64(Surroundings, float64)", Surroundings=SURROUNDINGS)
def balance_torque(surroundings: Record, q: float) -> float:
    """Torque of the counterbalance on its axis; see :meth:`.Counterbalance.torque`."""
    column, arm = surroundings.anchor_column, surroundings.anchor_arm
    area = surroundings.piston_area
    d = q - surroundings.q_min_force
    length = math.sqrt(column * column + arm * arm - 2.0 * column * arm * math.cos(d))
    lever = column * arm * math.sin(d) / length
    stroke = length - (column - arm)
    pressure: float = surroundings.gas_constant / (surroundings.gas_volume_max - stroke * area)
    torque: float = -lever * area * pressure
    return torque


@kernel("void(Chain, float64[:, ::1], float64[::1], float64[::1], int64, float64[:, ::1])", Chain=CHAIN)
def loads(chain: Compact, frame: Float, q: Float, w: Float, gravity: int, delta: Float) -> None:
    """Elastic displacement of every station under the wrench at the TCP and, on request, own weight; rigid geometry.

    ``delta[i] = compliance(q) * load`` with the load about the station's origin in the station's axes.
    """
    m = len(chain.stations) - 1
    surroundings = chain.surroundings[0]
    gx, gy, gz = surroundings.gravity[0], surroundings.gravity[1], surroundings.gravity[2]
    tip = frame[m]
    sx, sy, sz = 0.0, 0.0, 0.0  # first mass moment of all bodies from this station outward
    for k in range(m):
        i = m - 1 - k
        f, s = frame[i], chain.stations[i]
        lx, ly, lz = tip[9] - f[9], tip[10] - f[10], tip[11] - f[11]
        fx, fy, fz = w[0], w[1], w[2]
        mx = w[3] + ly * fz - lz * fy
        my = w[4] + lz * fx - lx * fz
        mz = w[5] + lx * fy - ly * fx
        twist = 0.0
        if gravity != 0:
            mass = s.mass
            a, b, c = s.com[0], s.com[1], s.com[2]
            sx += mass * (f[9] + f[0] * a + f[1] * b + f[2] * c)
            sy += mass * (f[10] + f[3] * a + f[4] * b + f[5] * c)
            sz += mass * (f[11] + f[6] * a + f[7] * b + f[8] * c)
            carried = s.carried
            hx, hy, hz = sx - carried * f[9], sy - carried * f[10], sz - carried * f[11]
            fx += carried * gx
            fy += carried * gy
            fz += carried * gz
            mx += hy * gz - hz * gy
            my += hz * gx - hx * gz
            mz += hx * gy - hy * gx
            if s.balanced != 0:
                twist = balance_torque(surroundings, q[abs(s.balanced) - 1])
                twist = twist if s.balanced > 0 else -twist
        if s.slides != 0:
            delta[i, 0] = s.compliance[0] * (f[0] * fx + f[3] * fy + f[6] * fz)
            delta[i, 1] = s.compliance[1] * (f[1] * fx + f[4] * fy + f[7] * fz)
            delta[i, 2] = s.compliance[2] * (f[2] * fx + f[5] * fy + f[8] * fz)
        if s.rotates != 0:
            delta[i, 3] = s.compliance[3] * (f[0] * mx + f[3] * my + f[6] * mz)
            delta[i, 4] = s.compliance[4] * (f[1] * mx + f[4] * my + f[7] * mz)
            delta[i, 5] = s.compliance[5] * (f[2] * mx + f[5] * my + f[8] * mz + twist)
    if len(chain.regions) > 0:
        grow(chain.regions, q, delta)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def pose_difference(a: Float, b: Float, out: Float) -> None:
    """``[p_b - p_a, log(R_b R_a^T)]`` of two poses (12,); accurate up to rotations of 170 deg."""
    for k in range(3):
        out[k] = b[9 + k] - a[9 + k]
    x = 0.5 * (a[3] * b[6] - a[6] * b[3] + a[4] * b[7] - a[7] * b[4] + a[5] * b[8] - a[8] * b[5])
    y = 0.5 * (a[6] * b[0] - a[0] * b[6] + a[7] * b[1] - a[1] * b[7] + a[8] * b[2] - a[2] * b[8])
    z = 0.5 * (a[0] * b[3] - a[3] * b[0] + a[1] * b[4] - a[4] * b[1] + a[2] * b[5] - a[5] * b[2])
    trace = 0.0
    for k in range(9):
        trace += a[k] * b[k]
    s2 = x * x + y * y + z * z
    # The sine is small near 180 deg too: the trace tells the two apart.
    if s2 <= SMALL * SMALL and trace > 1.0:
        ratio = small_asin_ratio(s2)
    else:
        s = math.sqrt(s2)
        ratio = math.atan2(s, 0.5 * (trace - 1.0)) / s if s > 0.0 else 0.0
    out[3], out[4], out[5] = ratio * x, ratio * y, ratio * z


@kernel("void(Chain, float64[:, ::1], float64[::1], float64[::1])", Chain=CHAIN)
def tcp_compliance(chain: Compact, frame: Float, q: Float, out: Float) -> None:
    """Cartesian compliance (36,) at the TCP in base axes: sum over the elements, 3x3 blocks."""
    t00, t01, t02, t11, t12, t22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r00, r01, r02, r11, r12, r22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    m = len(chain.stations) - 1
    tip = frame[m]
    for i in range(m):
        f, s = frame[i], chain.stations[i]
        if s.rotates != 0:
            a, b, c = s.compliance[3], s.compliance[4], s.compliance[5]
            if len(chain.regions) > 0:
                a *= growth_at(chain.regions, i, 3, q)
                b *= growth_at(chain.regions, i, 4, q)
                c *= growth_at(chain.regions, i, 5, q)
            ax, ay, az = a * f[0], a * f[3], a * f[6]
            bx, by, bz = b * f[1], b * f[4], b * f[7]
            cx, cy, cz = c * f[2], c * f[5], c * f[8]
            w00 = ax * f[0] + bx * f[1] + cx * f[2]
            w01 = ax * f[3] + bx * f[4] + cx * f[5]
            w02 = ax * f[6] + bx * f[7] + cx * f[8]
            w11 = ay * f[3] + by * f[4] + cy * f[5]
            w12 = ay * f[6] + by * f[7] + cy * f[8]
            w22 = az * f[6] + bz * f[7] + cz * f[8]
            r00 += w00
            r01 += w01
            r02 += w02
            r11 += w11
            r12 += w12
            r22 += w22
            x, y, z = tip[9] - f[9], tip[10] - f[10], tip[11] - f[11]
            # rows of w crossed with the lever: rotation by row, translation by column
            u00, u01, u02 = w01 * z - w02 * y, w02 * x - w00 * z, w00 * y - w01 * x
            u10, u11, u12 = w11 * z - w12 * y, w12 * x - w01 * z, w01 * y - w11 * x
            u20, u21, u22 = w12 * z - w22 * y, w22 * x - w02 * z, w02 * y - w12 * x
            m00 += u00
            m01 += u01
            m02 += u02
            m10 += u10
            m11 += u11
            m12 += u12
            m20 += u20
            m21 += u21
            m22 += u22
            # columns of u crossed with the lever
            t00 += u10 * z - u20 * y
            t01 += u11 * z - u21 * y
            t02 += u12 * z - u22 * y
            t11 += u21 * x - u01 * z
            t12 += u22 * x - u02 * z
            t22 += u02 * y - u12 * x
        if s.slides != 0:
            a, b, c = s.compliance[0], s.compliance[1], s.compliance[2]
            if len(chain.regions) > 0:
                a *= growth_at(chain.regions, i, 0, q)
                b *= growth_at(chain.regions, i, 1, q)
                c *= growth_at(chain.regions, i, 2, q)
            t00 += a * f[0] * f[0] + b * f[1] * f[1] + c * f[2] * f[2]
            t01 += a * f[0] * f[3] + b * f[1] * f[4] + c * f[2] * f[5]
            t02 += a * f[0] * f[6] + b * f[1] * f[7] + c * f[2] * f[8]
            t11 += a * f[3] * f[3] + b * f[4] * f[4] + c * f[5] * f[5]
            t12 += a * f[3] * f[6] + b * f[4] * f[7] + c * f[5] * f[8]
            t22 += a * f[6] * f[6] + b * f[7] * f[7] + c * f[8] * f[8]
    out[0], out[1], out[2], out[7], out[8], out[14] = t00, t01, t02, t11, t12, t22
    out[6], out[12], out[13] = t01, t02, t12
    out[21], out[22], out[23], out[28], out[29], out[35] = r00, r01, r02, r11, r12, r22
    out[27], out[33], out[34] = r01, r02, r12
    out[18], out[19], out[20] = m00, m01, m02
    out[24], out[25], out[26] = m10, m11, m12
    out[30], out[31], out[32] = m20, m21, m22
    out[3], out[9], out[15] = m00, m01, m02
    out[4], out[10], out[16] = m10, m11, m12
    out[5], out[11], out[17] = m20, m21, m22


@kernel("void(Chain, float64[:, ::1], float64[::1])", Chain=CHAIN)
def rigid_jacobian(chain: Compact, frame: Float, out: Float) -> None:
    """Jacobian (36,) at the TCP in base axes, row by row; column j belongs to controller angle j."""
    m = len(chain.stations) - 1
    tip = frame[m]
    for i in range(m):
        j = chain.stations[i].drive
        if j >= 0:
            f, sign = frame[i], chain.stations[i].sign
            ax, ay, az = sign * f[2], sign * f[5], sign * f[8]
            x, y, z = tip[9] - f[9], tip[10] - f[10], tip[11] - f[11]
            out[j] = ay * z - az * y
            out[6 + j] = az * x - ax * z
            out[12 + j] = ax * y - ay * x
            out[18 + j] = ax
            out[24 + j] = ay
            out[30 + j] = az
