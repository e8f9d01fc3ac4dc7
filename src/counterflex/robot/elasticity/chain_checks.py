"""Checks of a robot description before it becomes a chain: rigid poses, signs, plausible magnitudes."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import ModelError
from counterflex.robot.model.description import Counterbalance, Play, Robot, Segment, Servo

JOINTS = 6
_ROTATION_TOLERANCE = 1e-8  # largest deviation of R R^T from identity
_REACH_LIMIT = 20.0  # m; a longer link is a unit mistake
_MASS_LIMIT = 2e4  # kg
_SOFTEST_TRANSLATION = 1e-4  # m/N, a stiffness of 1e4 N/m
_SOFTEST_ROTATION = 1e-2  # rad/(N m), a stiffness of 100 N m/rad
_GRAVITY_LIMIT = 100.0  # m/s2
_LARGEST_ANGLE = 1e-2  # rad of play or slip; a worn gear has a tenth of that
_SMALLEST_SLIP = 1e-7  # rad
_LARGEST_FRICTION = 1e5  # N m


def finite(value: object, shape: tuple[int, ...], where: str) -> Float:
    """Return ``value`` as a finite float64 array of this shape, or raise a ModelError."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as fault:
        raise ModelError("not an array of numbers", where=where, value=repr(value)[:80]) from fault
    if array.shape != shape:
        raise ModelError("wrong shape", where=where, value=array.shape, limit=shape)
    if not np.all(np.isfinite(array)):
        raise ModelError("a number is not finite", where=where, value=array.tolist())
    return array


def rigid_motion(value: object, where: str) -> Float:
    """Return a checked rigid pose (4, 4) with lengths in m, or raise a ModelError."""
    T = finite(value, (4, 4), where)
    R = T[:3, :3]
    if np.max(np.abs(R @ R.T - np.eye(3))) > _ROTATION_TOLERANCE or np.linalg.det(R) < 0.0:
        raise ModelError("the pose does not hold a proper rotation", where=where, value=np.round(R, 6).tolist())
    if np.any(T[3] != (0.0, 0.0, 0.0, 1.0)):
        raise ModelError("the last row of a pose must be 0 0 0 1", where=where, value=T[3].tolist())
    if np.max(np.abs(T[:3, 3])) > _REACH_LIMIT:
        raise ModelError(
            "a link is implausibly long", where=where, value=T[:3, 3].tolist(), limit=f"{_REACH_LIMIT:g} m",
            hint="Lengths inside are in m",
        )  # fmt: skip
    return T


def fixed_pose(segment: Segment, where: str) -> Float:
    """Check one segment and return its fixed pose (4, 4), or raise a ModelError."""
    if segment.joint is not None and segment.joint not in range(JOINTS):
        raise ModelError("no such driven axis", where=where, value=segment.joint, limit="0..5 or None")
    if segment.sign not in (1.0, -1.0):
        raise ModelError("the sign of a drive must be +1 or -1", where=where, value=segment.sign)
    finite(segment.offset_rad, (), f"{where} offset_rad")
    compliance = finite(segment.compliance, (6,), f"{where} compliance")
    if np.any(compliance < 0.0):
        raise ModelError("a compliance is negative", where=where, value=compliance.tolist(), limit=">= 0")
    for part, limit, unit in (
        (compliance[:3], _SOFTEST_TRANSLATION, "m/N"),
        (compliance[3:], _SOFTEST_ROTATION, "rad/(N m)"),
    ):
        if np.any(part > limit):
            raise ModelError(
                "a compliance is implausibly large", where=where, value=float(part.max()), limit=f"<= {limit:g} {unit}",
                hint="Check the unit of the stiffness (N m/rad, N/m)",
            )  # fmt: skip
    mass = float(finite(segment.mass_kg, (), f"{where} mass_kg"))
    if not 0.0 <= mass <= _MASS_LIMIT:
        raise ModelError("a mass is out of range", where=where, value=mass, limit=f"0..{_MASS_LIMIT:g} kg")
    com = finite(segment.p_seg_com, (3,), f"{where} p_seg_com")
    if np.max(np.abs(com)) > _REACH_LIMIT:
        raise ModelError(
            "a centre of gravity is implausibly far out", where=where, value=com.tolist(), limit=f"{_REACH_LIMIT:g} m",
            hint="Lengths inside are in m",
        )  # fmt: skip
    return rigid_motion(segment.T_prev_seg, f"{where} T_prev_seg")


def joint_limits(robot: Robot) -> Float:
    """Return the checked joint limits (6, 2) rad, or raise a ModelError."""
    limits = finite(robot.joint_limits_rad, (JOINTS, 2), f"{robot.name}: joint_limits_rad")
    if np.any(limits[:, 0] >= limits[:, 1]):
        raise ModelError("a lower joint limit is not below the upper one", where=robot.name, value=limits.tolist())
    if np.max(np.abs(limits)) > 1000.0:
        raise ModelError("joint limits are implausibly large", where=robot.name, hint="Angles inside are in rad")
    return limits


def joint_speeds(robot: Robot) -> Float:
    """Return the checked joint speed limits (6,) rad/s, or raise a ModelError."""
    speeds = finite(robot.joint_speeds_rad_s, (JOINTS,), f"{robot.name}: joint_speeds_rad_s")
    if np.any(speeds <= 0.0):
        raise ModelError("a joint speed limit is not positive", where=robot.name, value=speeds.tolist())
    return speeds


def gravity_field(value: object) -> Float:
    """Return the checked field (3,) m/s2, or raise a ModelError."""
    gravity = finite(value, (3,), "gravity_base")
    if np.linalg.norm(gravity) > _GRAVITY_LIMIT:
        raise ModelError(
            "gravity is implausibly strong", value=gravity.tolist(), limit=f"{_GRAVITY_LIMIT:g} m/s2",
            hint="It is given in m/s2",
        )  # fmt: skip
    return gravity


def check_counterbalance(balance: Counterbalance, where: str) -> None:
    """Raise a ModelError where the numbers of a counterbalance contradict each other."""
    if balance.joint not in range(JOINTS):
        raise ModelError("the counterbalance acts on no driven axis", where=where, value=balance.joint, limit="0..5")
    numbers = (
        balance.anchor_column_m, balance.anchor_arm_m, balance.piston_area_m2,
        balance.gas_constant_j, balance.gas_volume_max_m3,
    )  # fmt: skip
    if not all(np.isfinite(v) and v > 0.0 for v in numbers) or not np.isfinite(balance.q_min_force_rad):
        raise ModelError("a number of the counterbalance is not positive and finite", where=where, value=numbers)
    stroke = 2.0 * min(balance.anchor_arm_m, balance.anchor_column_m)
    if stroke * balance.piston_area_m2 >= balance.gas_volume_max_m3:
        raise ModelError(
            "the stroke of the counterbalance is larger than its gas volume", where=where,
            value=stroke * balance.piston_area_m2, limit=f"< {balance.gas_volume_max_m3:g} m3",
        )  # fmt: skip


def check_play(play: tuple[Play | None, ...], where: str) -> None:
    """Raise a ModelError where the numbers of play and friction cannot be those of a robot."""
    if len(play) != JOINTS:
        raise ModelError("play and friction need one entry per driven axis", where=where, value=len(play), limit=JOINTS)
    for axis, entry in enumerate(play, start=1):
        if entry is None:
            continue
        place = f"{where}: play of axis {axis}"
        if len(entry.friction_nm) != len(entry.slip_rad):
            raise ModelError(
                "every friction element has one torque and one slip angle", where=place,
                value=(len(entry.friction_nm), len(entry.slip_rad)),
            )  # fmt: skip
        for name, values, least, most in (
            ("half_band_rad", (entry.half_band_rad,), 0.0, _LARGEST_ANGLE),
            ("friction_nm", entry.friction_nm, 0.0, _LARGEST_FRICTION),
            ("slip_rad", entry.slip_rad, _SMALLEST_SLIP, _LARGEST_ANGLE),
        ):
            numbers = finite(values, (len(values),), f"{place} {name}")
            if np.any(numbers < least) or np.any(numbers > most):
                raise ModelError(
                    f"{name} is out of range", where=place, value=numbers.tolist(), limit=f"{least:g}..{most:g}"
                )


def check_servo(servo: tuple[Servo | None, ...], where: str) -> None:
    """Raise a ModelError where loop gains cannot be those of a drive."""
    if len(servo) != JOINTS:
        raise ModelError("loop gains need one entry per driven axis", where=where, value=len(servo), limit=JOINTS)
    for axis, entry in enumerate(servo, start=1):
        if entry is None:
            continue
        place = f"{where}: servo of axis {axis}"
        for name, value, least, most in (
            ("speed_gain_nm_s", entry.speed_gain_nm_s, 1e-3, 1e9),
            ("position_gain_per_s", entry.position_gain_per_s, 0.1, 1e4),
            ("integral_time_s", entry.integral_time_s, 1e-4, 100.0),
            ("friction_nm", entry.friction_nm, 0.0, _LARGEST_FRICTION),
            ("slip_rad", entry.slip_rad, _SMALLEST_SLIP, _LARGEST_ANGLE),
        ):
            if not least <= float(finite(value, (), f"{place} {name}")) <= most:
                raise ModelError(f"{name} is out of range", where=place, value=value, limit=f"{least:g}..{most:g}")
