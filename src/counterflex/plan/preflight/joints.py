"""Joint limits, speeds, accelerations, the wrist singularity and the twist of cables along a program."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.path.toolpath import FEED, ToolPath
from counterflex.plan.preflight.row import NOT_LOOKED_AT, Bounds, Row, worst_of_axes
from counterflex.robot.model.controller_axes import ControllerAxes

_TURN: Final = "Turn the tool about its axis (counterflex plan posture), or move the part"
_SMOOTH: Final = 2.0 * math.sin(math.radians(1.5))
"""Change of velocity below which a path is smooth, by the speed: 3 deg, see :mod:`counterflex.path.path_speed`."""
CABLE_AXES: Final = (3, 5)
"""Axes 4 and 6: they turn by most, and hoses to the spindle are twisted by them."""
SPEED_KEY: Final = "limits.joint_speed_deg_s"
BETWEEN_KEY: Final = "robot.controller_axes.axis_3_to_upper_arm_deg"
ACCELERATION_KEY: Final = "limits.joint_acceleration_deg_s2"


def limit_row(margin_rad: Float, least_rad: float) -> Row:
    """The axis that comes nearest to its limit.

    Args:
        margin_rad: (n, 6) of :func:`counterflex.robot.model.controller_axes.room`.
        least_rad: Least margin.
    """
    row, axis = (int(i) for i in np.unravel_index(int(np.argmin(margin_rad)), margin_rad.shape))
    worst = float(margin_rad[row, axis])
    return Row(
        "joint limits",
        "ok" if worst >= least_rad else "fail",
        worst,
        least_rad,
        "rad",
        row,
        f"axis {axis + 1}" + (" is out of its range" if worst < 0.0 else ""),
        advice="" if worst >= least_rad else f"{_TURN}, or choose another branch (posture)",
    )


def between_row(axes: ControllerAxes) -> Row:
    """Return the row of the angle between the arms; it has own limits where axis 3 counts from the horizontal."""
    check = "axis 3 against the upper arm"
    if not axes.coupled:
        return Row(check, "ok", what="the controller counts axis 3 from it")
    if axes.between_known:
        return Row(check, "ok", what="one of the joint limits")
    return Row(check, NOT_LOOKED_AT, what="its limits are not stated", missing=BETWEEN_KEY)


def wrist_row(wrist: Float, least_rad: float) -> Row:
    """The point nearest to the wrist singularity.

    Args:
        wrist: (n,) ``|sin|`` of the angle between axes 4 and 6.
        least_rad: Least angle.
    """
    row = int(np.argmin(wrist))
    angle = float(np.arcsin(min(1.0, float(wrist[row]))))
    return Row(
        "wrist singularity",
        "ok" if angle >= least_rad else "fail",
        angle,
        least_rad,
        "rad",
        row,
        "axis 5",
        advice="" if angle >= least_rad else f"{_TURN}; the tool tilted by some degrees passes it as well",
    )


def joint_speeds(path: ToolPath, q: Float) -> Float:
    """Speed of each axis on the way to each row, ``(q_i - q_(i-1)) / (t_i - t_(i-1))`` at the programmed feed.

    Args:
        path: n rows; its times are those of the programmed feed.
        q: (n, 6) rad, continuous, as the controller shows them.

    Returns:
        (n, 6) rad/s, signed; 0 where no time passes and at row 0.
    """
    step = np.diff(path.time_s, prepend=path.time_s[:1])[:, None]
    out: Float = np.where(step > 0.0, np.diff(q, axis=0, prepend=q[:1]) / np.where(step > 0.0, step, 1.0), 0.0)
    return out


def joint_accelerations(path: ToolPath, speeds: Float, acceleration_m_s2: float) -> Float:
    """Acceleration of each axis at each row, at the programmed feed.

    At row i the speed of the axes changes by ``dv = speeds_(i+1) - speeds_i`` and the velocity of the tool by ``dV``.
    At corners, starts, stops and changes of feed the controller takes ``|dV| / a`` for it: the axes accelerate by
    ``J^-1 a`` along dV. It brakes before such a place and picks up speed behind it: ``J^-1 a`` along both sides counts,
    too; the largest of the three is returned. Where the path is smooth (within a motion, or less than 3 deg between
    two) the change is spread over half of both segments' times, never faster than at corners: on a sampled arc it is
    the acceleration of the arc.

    Args:
        path: n rows.
        speeds: (n, 6) rad/s of :func:`joint_speeds`.
        acceleration_m_s2: With which the controller changes the speed of the tool, > 0.

    Returns:
        (n, 6) rad/s2, signed.
    """
    step = np.diff(path.time_s, prepend=path.time_s[:1])
    move = np.diff(path.p_part_tcp, axis=0, prepend=path.p_part_tcp[:1])
    tool = np.where(step[:, None] > 0.0, move / np.where(step > 0.0, step, 1.0)[:, None], 0.0)
    passing = np.flatnonzero(step > 0.0)  # rows of no duration change nothing
    out = np.zeros_like(speeds)
    if len(passing) == 0:
        return out
    rest = np.zeros((1, speeds.shape[1]))
    v = np.concatenate([rest, speeds[passing], rest])
    tip = np.concatenate([np.zeros((1, 3)), tool[passing], np.zeros((1, 3))])
    dt = np.concatenate([[0.0], step[passing], [0.0]])
    change = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    size = np.linalg.norm(tip, axis=1)
    motion = np.concatenate([[-1], path.motion[passing], [-1]])
    corner = (np.diff(motion) != 0) & (change > _SMOOTH * np.maximum(size[:-1], size[1:]))
    half = np.where(corner, 0.0, 0.5 * (dt[:-1] + dt[1:]))
    time = np.maximum(half, change / acceleration_m_s2)
    at = np.diff(v, axis=0) / np.where(time > 0.0, time, 1.0)[:, None]
    per_m = v / np.where(size > 0.0, size, 1.0)[:, None]  # J^-1 along the feed, rad/m
    for brakes in (-per_m[:-1], per_m[1:]):
        along = acceleration_m_s2 * brakes * corner[:, None]
        at = np.where(np.abs(along) > np.abs(at), along, at)
    rows: Int = np.concatenate([[max(0, int(passing[0]) - 1)], passing])
    out[rows] = at
    return out


def at_feed(path: ToolPath) -> Bool:
    """(n,) rows whose segment, and the one behind it, are no rapids."""
    feed = path.kind == FEED
    out: Bool = feed & np.append(feed[1:], True)
    return out


def speed_rows(path: ToolPath, speeds: Float, bounds: Bounds) -> list[Row]:
    """Fastest axis at feed and in rapids, by its limit where that is known."""
    feed = (path.kind == FEED)[:, None]
    size = np.abs(speeds)
    limits = bounds.joint_speeds_rad_s
    rows = []
    for name, chosen in (("joint speed at feed", size * feed), ("joint speed in rapids", size * ~feed)):
        row, axis = worst_of_axes(chosen, limits)
        value = float(chosen[row, axis])
        rapid = name.endswith("rapids")
        if limits is None:
            rows.append(Row(name, NOT_LOOKED_AT, value, None, "rad/s", row, f"axis {axis + 1}", SPEED_KEY))
            continue
        over = value > limits[axis]
        advice = (
            "The controller runs this rapid more slowly, or stops" if rapid else "Lower the feed there, or " + _low()
        )
        rows.append(
            Row(
                name,
                "ok" if not over else "warning" if rapid else "fail",
                value,
                float(limits[axis]),
                "rad/s",
                row,
                f"axis {axis + 1}, {100 * value / limits[axis]:.1f} %",
                advice=advice if over else "",
            )
        )
    return rows


def _low() -> str:
    return _TURN[0].lower() + _TURN[1:]


def acceleration_row(path: ToolPath, joint_accelerations_rad_s2: Float, bounds: Bounds) -> Row:
    """Largest acceleration of an axis at feed, by its limit where that is known."""
    chosen = np.abs(joint_accelerations_rad_s2) * at_feed(path)[:, None]
    limits = bounds.joint_accelerations_rad_s2
    row, axis = worst_of_axes(chosen, limits)
    value, name = float(chosen[row, axis]), "joint acceleration at feed"
    if limits is None:
        return Row(name, NOT_LOOKED_AT, value, None, "rad/s2", row, f"axis {axis + 1}", ACCELERATION_KEY)
    over = value > limits[axis]
    return Row(
        name,
        "warning" if over else "ok",
        value,
        float(limits[axis]),
        "rad/s2",
        row,
        f"axis {axis + 1}, {100 * value / limits[axis]:.1f} %",
        advice="The controller is slower there than programmed: lower the feed, or round the corner" if over else "",
    )


def cable_rows(q: Float, cables_rad: dict[int, float]) -> list[Row]:
    """Turns of axes 4 and 6 to either side from 0 deg, where cables and hoses lie straight.

    Args:
        q: (n, 6) rad, continuous, full turns included.
        cables_rad: By axis 0..5 the largest angle, where known.
    """
    rows = []
    for axis in CABLE_AXES:
        row = int(np.argmax(np.abs(q[:, axis])))
        value, limit = float(abs(q[row, axis])), cables_rad.get(axis)
        turned = np.ptp(q[:, axis])
        over = limit is not None and value > limit
        rows.append(
            Row(
                f"cable wind-up, axis {axis + 1}",
                NOT_LOOKED_AT if limit is None else "fail" if over else "ok",
                value,
                limit,
                "rad",
                row,
                f"turns by {np.degrees(turned):.0f} deg in the program",
                f"limits.cable_axis{axis + 1}_deg" if limit is None else "",
                f"Turn the tool by a full turn back, or start axis {axis + 1} on its other side" if over else "",
            )
        )
    return rows
