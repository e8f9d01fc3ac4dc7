"""Kernel: the elastic robot in motion, advanced in time under a load on the tool.

Coordinates are the six link angles and every other elastic displacement of the chain. With M the inertia, D the damping
and K the stiffness of the posture,

    M x'' + D (x' - x_m') + K (x - x_m) = J^T w + t_weight + f,

where x_m are the motor angles behind the six gears, f is what play and dry friction add. Angles are counted from the
programmed path, and so are their rates: where the programmed speed changes by dq', every rate changes by -dq', which is
the load -M q'' of the path's own acceleration. The controller changes the speed of the tip by no more than its
acceleration. Rapids shake nothing: how they are run is not planned. Friction feels the whole motion. The linear part is
taken by the trapezoidal rule (no numerical damping, stable for massless elements), play, friction and drives follow one
step behind. The thrust of an end face that descends is a damper too stiff for that, and is solved for with the rates at
the end of the step (:mod:`counterflex.plan.bending_kernels`).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from counterflex.core.arrays import Float, Float1, Float2, Float3, Int, Int1
from counterflex.core.jit import bundle, kernel
from counterflex.plan.bending_kernels import AMPLITUDE, EXPONENT, PROGRAMMED, UP, thrust_of_step
from counterflex.robot.elasticity.play import spring_torque

AXES = 6


class MotionArrays(NamedTuple):
    """Arrays of :func:`advance`; rows are those of the path, n coordinates, m friction elements."""

    step_s: float  # length h of a step
    time_s: Float1  # (rows,) s
    q_command: Float2  # (rows, 6) rad, commanded angles, corrections included
    q_ref: Float2  # (rows, 6) rad, angles of the programmed path
    shaken: Int1  # (rows,) 1 where the programmed speed may change and shakes the arm on the way to the row, else 0
    acceleration: float  # of the tip, at most, m/s2: so fast the controller changes the programmed speed
    weight: Float2  # (rows, 6) N m, torque of weight and counterbalance on the torsions
    posture: Int1  # (rows,) which of the postures holds at a row
    place: Int1  # (rows,) which of the Jacobians does
    answer: Float3  # (postures, n, n) `h (M + h/2 D + h^2/4 K)^-1`, transposed
    keep: Float3  # (postures, n, n) `(M + h/2 D + h^2/4 K)^-1 (M - h/2 D - h^2/4 K)`, transposed
    J_tcp_part: Float3  # (places, 6, n) motion of the tool per coordinate, part axes
    J_drive_part: Float3  # (places, 6, 6) what is added per motor angle, for gears that yield beside their axis
    stiffness: Float2  # (rows, n) of each coordinate, even between rows; one row where it is the same everywhere
    damping: Float1  # (6,) N m s, of the gears
    half_band: Float1  # (6,) rad
    limit: Float2  # (6, m) N m
    slip: Float2  # (6, m) rad
    speed_gain: Float1  # (6,) N m s; 0 for a motor that never yields
    position_gain: Float1  # (6,) 1/s
    integral_time: Float1  # (6,) s
    motor_friction: Float1  # (6,) N m
    motor_slip: Float1  # (6,) rad
    x: Float1  # (n,) coordinates now
    rate: Float1  # (n,) their rates
    # (8, 6) motor angle, the one before, integral, friction held, load at the start, command before, all beside the
    # programmed angle; programmed angle before, programmed speed
    drives: Float2
    held: Float2  # (6, m) N m, friction of the links
    clock: Float1  # (2,) time of the state in s, and 1 once it has been set
    program: Float1  # (6,) rad, working space
    load: Float1  # (n,) working space
    fresh: Float1  # (n,) working space
    thrust: Float1  # (7,) of counterflex.plan.bending_kernels, set before a call; it acts beside the wrench
    pushed: Float1  # (n,) working space


MOTION: Final = bundle(MotionArrays)

STATE_ARRAYS: Final = ("x", "rate", "drives", "held", "clock", "program", "load", "fresh", "thrust", "pushed")
"""Fields of :class:`MotionArrays` that :func:`advance` writes; zeros until :func:`rest`."""


@kernel("void(float64[:,::1], float64, int64[::1])", entry=True)
def number_postures(q: Float, apart_rad: float, out: Int) -> None:
    """Number the postures of a path: a row more than ``apart_rad`` from the last that stands begins a new one.

    Args:
        q: (rows, axes) rad.
        apart_rad: Largest change of an axis within a posture.
        out: (rows,), written.
    """
    stands, number = 0, 0
    for i in range(1, q.shape[0]):
        for a in range(q.shape[1]):
            if not abs(q[i, a] - q[stands, a]) <= apart_rad:
                stands = i
                number += 1
                break
        out[i] = number


@kernel("void(Motion, int64)", Motion=MOTION)
def rest(motion: MotionArrays, row: int) -> None:
    """Put the state at rest under the weight at a row, gears leaning as their load asks."""
    stiffness = motion.stiffness[min(row, motion.stiffness.shape[0] - 1)]
    for i in range(motion.x.shape[0]):
        motion.x[i] = 0.0
        motion.rate[i] = 0.0
    for a in range(AXES):
        torque = motion.weight[row, a]
        lean = min(max(torque, -1.0), 1.0) * motion.half_band[a]
        offset = motion.q_command[row, a] - motion.q_ref[row, a]
        motion.x[a] = offset + torque / stiffness[a] + lean
        motion.drives[0, a] = offset
        motion.drives[1, a] = offset
        motion.drives[2, a] = 0.0
        motion.drives[3, a] = 0.0
        motion.drives[4, a] = torque
        motion.drives[5, a] = offset
        motion.drives[6, a] = motion.q_ref[row, a]
        motion.drives[7, a] = 0.0
        for e in range(motion.limit.shape[1]):
            motion.held[a, e] = 0.0
    motion.clock[0] = motion.time_s[row]
    motion.clock[1] = 1.0


@kernel("void(Motion, int64)", disjoint=True, Motion=MOTION)
def _shake(motion: MotionArrays, row: int) -> None:
    """Change the programmed speed towards that of the step, by what the controller can, and all rates against it."""
    h, J, due = motion.step_s, motion.J_tcp_part[motion.place[row]], motion.pushed
    share = 1.0
    for a in range(AXES):
        due[a] = motion.program[a] / h - motion.drives[7, a]
    if motion.shaken[row] != 0:
        square = 0.0
        for k in range(3):
            change = 0.0
            for a in range(AXES):
                change += J[k, a] * due[a]
            square += change * change
        most = h * motion.acceleration
        if square > most * most:
            share = most / math.sqrt(square)
    for a in range(AXES):
        change = share * due[a]
        motion.drives[7, a] += change
        if motion.shaken[row] != 0:
            motion.rate[a] -= change


@kernel("void(Motion, int64)", disjoint=True, Motion=MOTION)
def _push_back(motion: MotionArrays, row: int) -> None:
    """Add to the rates at the end of the step what the thrust of the end face does meanwhile."""
    n, h, thrust, pushed = motion.x.shape[0], motion.step_s, motion.thrust, motion.pushed
    J, J_drive = motion.J_tcp_part[motion.place[row]], motion.J_drive_part[motion.place[row]]
    A = motion.answer[motion.posture[row]]
    descent, gain = thrust[PROGRAMMED], 0.0
    for a in range(AXES):
        turned = (motion.drives[0, a] - motion.drives[1, a]) / h
        for k in range(3):
            descent -= thrust[UP + k] * J_drive[k, a] * turned
    for i in range(n):
        pushed[i] = 0.0
    for j in range(n):
        up, row_of = thrust[UP] * J[0, j] + thrust[UP + 1] * J[1, j] + thrust[UP + 2] * J[2, j], A[j]
        for i in range(n):
            pushed[i] += row_of[i] * up
    for i in range(n):
        up = thrust[UP] * J[0, i] + thrust[UP + 1] * J[1, i] + thrust[UP + 2] * J[2, i]
        descent -= up * motion.fresh[i]
        gain += up * pushed[i]
    force = thrust_of_step(descent, gain, thrust[AMPLITUDE], thrust[EXPONENT])
    for i in range(n):
        motion.fresh[i] += pushed[i] * force


@kernel("void(Motion, int64, float64, float64[::1], float64[::1])", disjoint=True, Motion=MOTION)
def advance(motion: MotionArrays, row: int, until_s: float, wrench: Float, out: Float) -> None:
    """Advance within the row that ends at ``row`` and give the tool's deviation from the programmed path.

    Args:
        motion: See :class:`MotionArrays`; its state is changed.
        row: Index, >= 1.
        until_s: Time to come to; the state stops less than a step before it and is extrapolated by its rate.
        wrench: (6,) N, N m on the tool, part axes, held meanwhile.
        out: (6,) m, rad, written.
    """
    n = motion.x.shape[0]
    h = motion.step_s
    at = motion.posture[row]
    A, B, J = motion.answer[at], motion.keep[at], motion.J_tcp_part[motion.place[row]]
    x, v, load, fresh = motion.x, motion.rate, motion.load, motion.fresh
    last = motion.stiffness.shape[0] - 1
    before_k, after_k = motion.stiffness[min(row - 1, last)], motion.stiffness[min(row, last)]
    start, length = motion.time_s[row - 1], motion.time_s[row] - motion.time_s[row - 1]
    while motion.clock[0] + h <= until_s:
        share = min(max((motion.clock[0] + h - start) / length, 0.0), 1.0) if length > 0.0 else 1.0
        for i in range(n):
            load[i] = 0.0
        for k in range(6):
            push, row_of = wrench[k], J[k]
            for i in range(n):
                load[i] += row_of[i] * push
        for a in range(AXES):
            place = motion.q_ref[row - 1, a] + share * (motion.q_ref[row, a] - motion.q_ref[row - 1, a])
            q = motion.q_command[row - 1, a] + share * (motion.q_command[row, a] - motion.q_command[row - 1, a]) - place
            along = place - motion.drives[6, a]
            motion.program[a] = along
            motion.drives[6, a] = place
            motor, before = motion.drives[0, a], motion.drives[1, a]
            spring = before_k[a] + share * (after_k[a] - before_k[a])
            through = spring_torque(x[a] - motor, 1.0 / spring, motion.half_band[a])
            load[a] += motion.weight[row - 1, a] + share * (motion.weight[row, a] - motion.weight[row - 1, a]) - through
            for e in range(motion.limit.shape[1]):
                load[a] += motion.held[a, e]
            new = q
            if motion.speed_gain[a] > 0.0:
                if motion.motor_friction[a] > 0.0:
                    most = motion.motor_friction[a]
                    grip = motion.drives[3, a] - most / motion.motor_slip[a] * (motor - before + along)
                    motion.drives[3, a] = min(max(grip, -most), most)
                torque = through - motion.drives[4, a] + motion.drives[3, a]
                rate = torque / motion.speed_gain[a] - motion.drives[2, a] / motion.integral_time[a]
                lag = motor - motion.drives[5, a]
                motion.drives[2, a] += h * rate
                # An even command is followed without error; only the deviation from it passes the loops.
                new = q + lag + h * (rate - motion.position_gain[a] * lag)
            load[a] += motion.damping[a] * (new - motor) / h
            motion.drives[1, a] = motor
            motion.drives[0, a] = new
            motion.drives[5, a] = q
        _shake(motion, row)
        for i in range(AXES, n):
            load[i] -= (before_k[i] + share * (after_k[i] - before_k[i])) * x[i]
        for i in range(n):
            fresh[i] = 0.0
        for j in range(n):  # by columns: n sums side by side run in vectors, one sum behind the other does not
            rate, push, kept, answered = v[j], load[j], B[j], A[j]
            for i in range(n):
                fresh[i] += kept[i] * rate + answered[i] * push
        if motion.thrust[AMPLITUDE] > 0.0:
            _push_back(motion, row)
        for i in range(n):
            moved = 0.5 * h * (v[i] + fresh[i])
            x[i] += moved
            v[i] = fresh[i]
            if i < AXES:
                moved += motion.program[i]
                for e in range(motion.limit.shape[1]):
                    most = motion.limit[i, e]
                    if most > 0.0:
                        force = motion.held[i, e] - most / motion.slip[i, e] * moved
                        motion.held[i, e] = min(max(force, -most), most)
        motion.clock[0] += h
    ahead = until_s - motion.clock[0]
    share = min(max((until_s - start) / length, 0.0), 1.0) if length > 0.0 else 1.0
    for k in range(6):
        out[k] = 0.0
    for i in range(n):
        value = x[i] + ahead * v[i]
        if i < AXES:
            before = motion.weight[row - 1, i]
            weight = before + share * (motion.weight[row, i] - before)
            # The sag under the weight is part of the residual sag of the path (sag_and_play): counted there, once.
            value -= weight / (before_k[i] + share * (after_k[i] - before_k[i]))
        for k in range(6):
            out[k] += J[k, i] * value
    for a in range(AXES):
        for k in range(6):
            out[k] += motion.J_drive_part[motion.place[row], k, a] * motion.drives[0, a]
