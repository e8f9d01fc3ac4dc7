"""Reversal datasets as motions of single axes, checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from counterflex.core.arrays import Float, Int, rows_of_each
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import DEG, MM, MRAD, URAD
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.robot.elasticity.play import FLOATING_NM, axis_torque

FEWEST: Final = 30
"""Rows of a motion."""
ALONE: Final = 0.2
"""Range of the other axes against the moving one, at most."""
LONGEST_M: Final = 10.0
"""Distance of a tool from an axis that no arm has."""
TURNED: Final = 0.5
"""Share of the longest stroke behind which all friction acts: 0.4 mrad of strokes of 0.8, where elements slip after
twice up to 0.1 mrad and dead bands are twice up to 0.07. Shares of 0.3 to 0.7 give the loop within 1 % in the mean."""
_LEAST_RAD = 100.0 * URAD
_LEAST_M = 0.02 * MM
_SLOW_RAD_S = 50.0 * MRAD


@dataclass(frozen=True, eq=False)
class ReversalMotion:
    """One motion of one axis with reversals."""

    run: int  # number in the dataset
    axis: int  # 0..5
    by: Literal["encoder", "tracker"]  # what saw the link
    q: Float  # (n,) rad, motor angle
    # (n,) N m about the axis by weight and cylinder; its mean by the motor's torque where that was recorded, because
    # masses are hardly known well enough to say which flank of the gear bears (an upright axis bears no weight at all,
    # and keeps that)
    torque: Float
    time_s: Float | None  # (n,) or None
    measured: Float  # (n,) rad link minus motor, or m along the motion of the tool
    sigma: Float
    motor_torque: Float | None  # (n,) N m or None
    where: str
    lever_m: float = float("inf")  # distance that the tool moves per rad; infinite for encoders
    pose: Float = field(default_factory=lambda: np.zeros(6))  # (6,) rad, mean angles of all axes


def motions(cell: CellModel, data: Sequence[Dataset], first_run: int = 0) -> list[ReversalMotion]:
    """All motions of some datasets.

    ``cell``: Its weight loads the axes. ``data``: Of kind ``reversals``: ``q_motor`` or ``q`` of six axes, ``q_link``
    or ``p_tracker_target``; perhaps ``time_s`` and ``tau_motor``. Rows of one group are one motion.

    Raises:
        FileFormatError: A channel or standard deviation is missing, values are not numbers, time runs backwards.
        InputError: More than one axis moves, hardly any motion, too fast, too few rows, or angles in wrong units.
    """
    out: list[ReversalMotion] = []
    for dataset in data:
        lead = "q_motor" if dataset.has("q_motor") else "q"
        q = dataset.values(lead)
        if q.shape[1] != 6:
            raise InputError(f"reversals need '{lead}' of all six axes", where=dataset.where, value=q.shape[1], limit=6)
        seen = "q_link" if dataset.has("q_link") else "p_tracker_target"
        names = [lead, seen, *(n for n in ("time_s", "tau_motor") if dataset.has(n))]
        for name in names:
            dataset.finite(name)
        limits = cell.robot.joint_limits_rad
        far = np.any((q < limits[:, 0] - 5.0 * DEG) | (q > limits[:, 1] + 5.0 * DEG), axis=1)
        if far.any():
            raise InputError(
                f"'{lead}' is beyond the joint limits of the robot",
                where=dataset.place(int(np.argmax(far))),
                value=f"{np.round(q[int(np.argmax(far))] / DEG, 1).tolist()} deg",
                hint=f'If the file is in deg, write unit = "deg" under [channels.{lead}]',
            )
        for _, rows in rows_of_each(dataset.group):
            out.append(_motion(cell, dataset, rows, lead, seen, first_run + len(out)))
    return out


def _motion(cell: CellModel, dataset: Dataset, rows: np.ndarray, lead: str, seen: str, run: int) -> ReversalMotion:
    place = dataset.place(int(rows[0]))
    if len(rows) < FEWEST:
        raise InputError("a motion has too few rows", where=place, value=len(rows), limit=f">= {FEWEST}")
    q = dataset.values(lead)[rows]
    span = np.ptp(q, axis=0)
    axis = int(np.argmax(span))
    if span[axis] < _LEAST_RAD:
        raise InputError(
            "no axis moves far enough to reverse its play",
            where=place,
            value=f"{span[axis] / URAD:.3g} urad",
            limit=f">= {_LEAST_RAD / URAD:g} urad",
        )
    others = np.delete(span, axis)
    if float(np.max(others)) > ALONE * span[axis]:
        raise InputError(
            "more than one axis moves; a reversal motion turns one axis alone",
            where=place,
            value=f"ranges {np.round(span / MRAD, 3).tolist()} mrad",
        )
    time = _times(dataset, rows, q[:, axis], seen) if dataset.has("time_s") else None
    torque = axis_torque(cell.chain, q)[:, axis]
    motor = dataset.values("tau_motor")[rows, axis] if dataset.has("tau_motor") else None
    if motor is not None and time is not None and float(np.max(np.abs(torque))) > FLOATING_NM:
        torque = torque - np.mean(torque) - balance(q[:, axis], time, motor)[0]
    channel = dataset.channel(seen)
    sigma = channel.need_sigma()[rows]
    value, pose = channel.values[rows], q.mean(axis=0)
    if seen == "q_link":
        gap = _gap(value, q, axis, lead, place)
        return ReversalMotion(
            run, axis, "encoder", q[:, axis], torque, time, gap, sigma[:, axis], motor, place, pose=pose
        )
    lever, along = _lever(value, q[:, axis], place)
    sideways = np.sqrt(sigma**2 @ along**2)
    return ReversalMotion(
        run, axis, "tracker", q[:, axis], torque, time, value @ along, sideways, motor, place, lever, pose
    )


def _times(dataset: Dataset, rows: Int, q: Float, seen: str) -> Float:
    """Stamps (m,) of a motion; refuse those that do not rise and, where a tracker looks on, fast motions."""
    time: Float = dataset.values("time_s")[rows, 0]
    if np.any(np.diff(time) <= 0.0):
        row = int(rows[int(np.argmin(np.diff(time))) + 1])
        raise FileFormatError(
            "time runs backwards or stands still within a motion",
            where=dataset.place(row),
            hint="Remove repeated rows; without time_s each row counts as a point at rest",
        )
    speed = float(np.percentile(np.abs(np.gradient(q, time)), 95))
    if speed > _SLOW_RAD_S and seen == "p_tracker_target":
        raise InputError(
            "the axis moves too fast to separate play from delay and inertia",
            where=dataset.place(int(rows[0])),
            value=f"{speed / MRAD:.3g} mrad/s",
            limit=f"<= {_SLOW_RAD_S / MRAD:g} mrad/s",
        )
    return time


def _gap(link: Float, q: Float, axis: int, lead: str, place: str) -> Float:
    """Angle (m,) of the link beyond that of the motor."""
    if link.shape[1] != 6:
        raise InputError("reversals need 'q_link' of all six axes", where=place, value=link.shape[1], limit=6)
    gap: Float = link[:, axis] - q[:, axis]
    span = np.ptp(q[:, axis])
    if float(np.ptp(gap)) > 0.5 * span:
        raise InputError(
            "'q_link' does not follow the motor: a wrong axis, unit or sign",
            where=place,
            value=f"{np.ptp(link[:, axis]) / span:.3g} times the motion of '{lead}'",
            limit="1",
        )
    return gap


def _lever(p: Float, q: Float, place: str) -> tuple[float, Float]:
    """Metres that a target moves per radian of an axis, and the direction (3,) in which it does."""
    angle, span = q - np.mean(q), np.ptp(q)
    slope = np.polyfit(angle, p - np.mean(p, axis=0), 1)[0]
    lever = float(np.linalg.norm(slope))
    if lever * span < _LEAST_M:
        raise InputError(
            "the tool hardly moves while the axis turns; choose a pose with the tool off the axis",
            where=place,
            value=f"{lever * span / MM:.3g} mm",
            limit=f">= {_LEAST_M / MM:g} mm",
        )
    if not lever < LONGEST_M:
        raise InputError(
            "the tool moves farther than any arm could carry it: 'p_tracker_target' or the angles are in a wrong unit",
            where=place,
            value=f"{lever:.3g} m per rad",
            limit=f"< {LONGEST_M:g}",
        )
    return lever, slope / lever


def balance(q: Float, time_s: Float, motor: Float) -> tuple[float, float]:
    """Estimate from the motor's torque in a slow motion the torque that holds the weight, and dry friction.

    Least squares of ``tau = t_0 + k (q - mean q) + t_1 sgn(dq/dt)`` where the axis moves and has left its last turn
    behind: while the gear crosses its play and friction turns round, the motor carries a part of the friction only, and
    the loop of all rows is up to 30 % too narrow.

    Args:
        q: (n,) rad.
        time_s: (n,) s.
        motor: (n,) N m.

    Returns:
        t_0 (the weight turns the axis with ``-t_0``) and t_1, half the loop: dry friction of link and motor, N m; NaN
        for t_1 where the motion does not run both ways.
    """
    speed = np.gradient(q, time_s)
    quick = np.abs(speed) > 0.5 * np.percentile(np.abs(speed), 90)
    since = since_turn(q, np.where(quick, np.sign(speed), 0.0))
    quick &= since >= TURNED * np.max(since)
    if (quick & (speed > 0.0)).sum() < 5 or (quick & (speed < 0.0)).sum() < 5:
        return float(np.mean(motor)), float("nan")
    B = np.stack([np.ones(len(q)), q - q.mean(), np.sign(speed)], axis=1)[quick]
    t = np.linalg.lstsq(B / np.linalg.norm(B, axis=0), motor[quick], rcond=None)[0] / np.linalg.norm(B, axis=0)
    return float(t[0]), float(t[2])


def since_turn(q: Float, way: Float) -> Float:
    """(n,) rad that an axis has moved since it last turned round.

    Args:
        q: (n,) rad.
        way: (n,) sense of the motion, 0 where it hardly moves.
    """
    out = np.zeros(len(q))
    start, last = float(q[0]), 0.0
    for k in range(1, len(q)):
        if way[k] != 0.0 and last != 0.0 and way[k] != last:
            start = float(q[k - 1])
        last = float(way[k]) or last
        out[k] = abs(float(q[k]) - start)
    return out


def motor_friction(mine: Sequence[ReversalMotion]) -> float | None:
    """Half the difference of the motor's torque between the directions of motion, N m; None if it was not recorded."""
    seen = _motor_halves(mine)
    return float(np.mean(seen)) if seen else None


def motor_friction_sigma(mine: Sequence[ReversalMotion]) -> float:
    """Standard deviation of :func:`motor_friction` by its scatter over the motions, N m; 0 with fewer than two."""
    seen = _motor_halves(mine)
    return float(np.std(seen, ddof=1) / np.sqrt(len(seen))) if len(seen) > 1 else 0.0


def _motor_halves(mine: Sequence[ReversalMotion]) -> list[float]:
    halves = [
        balance(m.q, m.time_s, m.motor_torque)[1] for m in mine if m.motor_torque is not None and m.time_s is not None
    ]
    return [half for half in halves if np.isfinite(half)]
