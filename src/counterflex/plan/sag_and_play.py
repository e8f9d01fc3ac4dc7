"""Errors of the robot itself along the path: sag under its own weight, and lost motion of its drives.

A part frame measured with the robot itself (touching datum points) already contains the sag, the geometric error and
the play that the robot has at those points: there they cancel. What remains is how they vary across the part. A frame
measured with an external instrument contains nothing, and the whole sag remains.

What the axes lose depends on where they come from, so the whole path counts, air moves included; and a correction
moves the axes itself, so it is asked of the corrected path. Friction is relaxed at the first point, as after a rest,
and was relaxed at the touched points.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.jit import kernel
from counterflex.geometry import pose
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.plan.bending_kernels import oscillator
from counterflex.plan.inputs import Setting
from counterflex.plan.relative_motion import RelativeMotion
from counterflex.robot.elasticity import gravity, play
from counterflex.robot.elasticity.chain import ElasticChain, forward, jacobian
from counterflex.robot.elasticity.servo import servo_error
from counterflex.robot.kinematics.inverse import inverse_path
from counterflex.signals.preview import Mode

_ROUNDING_M = 1e-12
"""Deviations below this are what the transforms round: a robot without sag deviates by exactly nothing."""


def true_part_frame(T_base_part: Float, datum_points_part: Float, sag_base_datum: Float) -> Float:
    """Pose of the part when its frame was measured by touching points with a sagging robot.

    The controller saw ``T_base_part p`` at each datum point p; the tool was truly at that position plus the sag.

    Args:
        T_base_part: (4, 4) the frame the controller got.
        datum_points_part: (k, 3) m, k >= 3.
        sag_base_datum: (k, 3) m, sag of the tool tip at those points, base axes.

    Returns:
        (4, 4) the pose of the part that best explains what was touched.
    """
    seen = pose.transform(T_base_part, datum_points_part)
    T_base_true, _ = pose.register(seen + sag_base_datum, datum_points_part)
    return T_base_true


def sag_deviation(T_base_part: Float, T_base_true: Float, p_part: Float, sag_base: Float) -> Float:
    """Deviation of the unloaded tool tip from the programmed point, in the frame of the part as it truly lies.

    Args:
        T_base_part: (4, 4) the frame the controller uses.
        T_base_true: (4, 4) from :func:`true_part_frame`, or ``T_base_part`` for an externally measured frame.
        p_part: (n, 3) m programmed points.
        sag_base: (n, 3) m sag of the tool tip there, base axes.

    Returns:
        (n, 3) m, actual - nominal.
    """
    p_base = pose.transform(T_base_part, p_part) + sag_base
    out: Float = pose.transform(pose.inverse(T_base_true), p_base) - np.asarray(p_part, dtype=np.float64)
    out[np.abs(out) < _ROUNDING_M] = 0.0
    return out


def residual_sag(p_part: Float, q: Float, setting: Setting, relative: RelativeMotion) -> Float:
    """(n, 3) m, deviation of the unloaded tool along the path, see :mod:`counterflex.plan.sag_and_play`.

    What the robot does at its commanded joint angles with nothing but its own weight on it: sag, periodic errors of its
    drives, and the difference between its geometry and the one the controller has.
    """
    off = _unloaded_offset(setting, q)
    touched = touched_points(setting)
    if touched is None:
        out: Float = relative.displacement(off)[:, :3]
        return np.where(np.abs(out) < _ROUNDING_M, 0.0, out)
    datum, q_datum = touched
    T_base_true = true_part_frame(setting.T_base_part, datum, _unloaded_offset(setting, q_datum)[:, :3])
    sag = off[:, :3]
    if setting.places is not None:  # seen from the base as it stood when the frame was measured
        sag = relative.displacement(off)[:, :3] @ setting.T_base_part[:3, :3].T
    return sag_deviation(setting.T_base_part, T_base_true, p_part, sag)


def touched_points(setting: Setting) -> tuple[Float, Float] | None:
    """Datum points (k, 3) m in the part frame and the angles (k, 6) rad at them; None for a frame from outside."""
    if setting.datum_points_part is None:
        return None
    datum = setting.datum_points_part
    axes = np.tile([0.0, 0.0, 1.0], (len(datum), 1))
    Rs_part_tcp = tool_orientation(axes, setting.rotation_about_tool_rad)
    Ts_base_tcp = tool_poses(setting.T_base_part, datum, Rs_part_tcp)
    return datum, inverse_path(setting.controller_chain, Ts_base_tcp, setting.branch).q


def _unloaded_offset(setting: Setting, q: Float) -> Float:
    """(n, 6) m, rad, true minus believed pose of the unloaded hand, base axes."""
    off: Float = gravity.sag(setting.chain, q)
    if setting.controller_chain is not setting.chain or setting.drive_errors:
        links = setting.drive_errors.link_angles(q)
        off = off + pose.difference(forward(setting.controller_chain, q), forward(setting.chain, links))
    return off


def play_deviation(
    chain: ElasticChain,
    relative: RelativeMotion,
    p_part: Float,
    q: Float,
    w_tcp_part: Float,
    time_s: Float,
    touched: tuple[Float, Float] | None,
    mode: Mode,
) -> Float:
    """Deviation of the tool by lost motion and by motors that yield, beside sag and deflection.

    Args:
        chain: Robot and end effector with play and servo gains; without both, the deviation is exactly zero.
        relative: How the tool moves relative to the part.
        p_part: (n, 3) m, programmed points in the order of the path.
        q: (n, 6) rad, commanded angles there, corrections included.
        w_tcp_part: (n, 6) N, N m, process wrench about the tip in part axes.
        time_s: (n,) s.
        touched: Datum points (k, 3) m in the part frame and the angles (k, 6) rad at which they were touched, or None
            for a frame measured from outside.
        mode: The structural mode through which the process load reaches the motors.

    Returns:
        (n, 3) m, part axes, actual - nominal.
    """
    if chain.play is None and chain.servo is None:
        return np.zeros((len(p_part), 3))
    lost, load = play.torsion(chain, q, relative.load(w_tcp_part))
    if chain.servo is not None:
        lost = lost + servo_error(chain.servo, q, swing(load, time_s, mode), time_s)
    off = relative.displacement(play.at_tcp(chain, q, lost))[:, :3]
    return in_touched_frame(chain, relative, p_part, touched, off)


def in_touched_frame(
    chain: ElasticChain,
    relative: RelativeMotion,
    p_part: Float,
    touched: tuple[Float, Float] | None,
    deviation_part: Float,
) -> Float:
    """Deviation from a path in a part frame that was touched with play in the axes.

    Args:
        chain: Robot and end effector.
        relative: How the tool moves relative to the part.
        p_part: (n, 3) m, programmed points.
        touched: See :func:`play_deviation`.
        deviation_part: (n, 3) m, actual minus commanded tip, axes of the part frame that the controller has.

    Returns:
        (n, 3) m, part axes.
    """
    T_base_part = relative.T_base_part
    if touched is None or chain.play is None or T_base_part is None:
        return np.where(np.abs(deviation_part) < _ROUNDING_M, 0.0, deviation_part)
    datum, q_datum = touched
    # The frame was touched with the axes leaning under their weight: what they lose there is in it already.
    there = play.at_tcp(chain, q_datum, play.relaxed(chain, q_datum))[:, :3]
    T_base_true = true_part_frame(T_base_part, datum, there)
    return sag_deviation(T_base_part, T_base_true, p_part, deviation_part @ T_base_part[:3, :3].T)


def corrected_joints(chain: ElasticChain, relative: RelativeMotion, q: Float, correction: Float, turn: Float) -> Float:
    """Angles of a corrected point from those of the programmed one, ``q + J(q)^-1 X^-1 u``.

    Corrections are millimetres over metres: the second order is below 1e-6 rad.

    Args:
        chain: As the controller has it.
        relative: How the tool moves relative to the part, X.
        q: (n, 6) rad, away from singularities.
        correction: (n, 3) m, part axes.
        turn: (n, 3) rad, part axes.

    Returns:
        (n, 6) rad; rows without a correction are returned as they are.
    """
    out = q.copy()
    rows = np.flatnonzero(np.any(correction != 0.0, axis=1) | np.any(turn != 0.0, axis=1))
    if len(rows):
        u = np.concatenate([correction[rows], turn[rows]], axis=1)
        J_part = relative.rows(rows).to_part @ jacobian(chain, q[rows])
        out[rows] += np.linalg.solve(J_part, u[..., None])[..., 0]
    return out


@kernel("void(float64[:,::1], float64[::1], float64, float64, float64[:,::1])", entry=True)
def _swing(static: Float, time: Float, omega: float, zeta: float, out: Float) -> None:
    x, v = static[0].copy(), np.zeros(static.shape[1])
    out[0] = x
    for i in range(1, static.shape[0]):
        dt = time[i] - time[i - 1]
        if dt > 0.0:
            a, b, c, d = oscillator(dt, omega, zeta)
            for k in range(static.shape[1]):
                rest = x[k] - static[i, k]
                x[k] = static[i, k] + a * rest + b * v[k]
                v[k] = c * rest + d * v[k]
        out[i] = x


def swing(static: Float, time_s: Float, mode: Mode) -> Float:
    """Response of a structure of one mode to what acts at its end.

    ``x'' + 2 zeta w x' + w^2 x = w^2 x_static(t)``, started at rest at the first value, with the value of each row held
    since the row before; exact for that.

    Args:
        static: (n, k), for example the loads on the drives if the structure passed them on at once.
        time_s: (n,) non-decreasing.

    Returns:
        (n, k) at the times of the rows.
    """
    values = np.array(as_float("static", static, (None, None)))
    out = np.empty_like(values)
    if len(values):
        time = np.array(as_float("time_s", time_s, (len(values),)))
        _swing(values, time, mode.omega_rad_s, mode.damping_ratio, out)
    return out
