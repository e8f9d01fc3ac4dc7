"""Memory of the online step from one cycle to the next."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record

FUSION: Final = record(
    estimate=(float, 9),  # factors k, shares a, offset b: feed, across, along the tool each; b in part axes, m
    covariance=(float, (9, 9)),
    turn=(float, 3),  # offset of the orientation, rad
    turn_variance=float,
    bent=(float, 18),  # deflection (6) of this cycle under the predicted force along each direction, part axes
    row=(float, 9),  # work space: the measurement's row H
    product=(float, 9),  # work space: P H
    gain=(float, 9),  # work space: K
)
"""State of :mod:`counterflex.runtime.estimator.fusion_kernel`."""

PAST_ROWS: Final = 256
"""Cycles that are remembered."""
PAST: Final = record(
    nominal=(float, 12),  # commanded pose, rotation by rows and position m, part frame
    sent=(float, 6),  # correction
    deflection=(float, 6),
    in_effect=(float, 6),  # correction in effect
    contained=(float, 6),  # correction that the program contains
    frame=(float, 9),  # directions: feed, across, along the tool
    bent=(float, 18),  # deflection under the predicted force along each
    clock=float,  # cycles of the controller
    stand=(float, 3),  # where the tool should stand, part frame
    swing=float,  # see STATE
)
"""A cycle of the past."""

SUPERVISOR: Final = record(
    state=int,
    cause=int,  # latched until reset, or until ACTIVE is reached again from HOLD
    cycles=int,  # in the present state
    good=int,  # cycles without a soft cause, in HOLD
    risen=int,  # 0 .. rise cycles: how far the correction has been faded in
    feed_hold=int,  # 1: the robot is to hold its feed
    stop=int,  # cycles left in which the robot is told to stop behind a ramp
    returns=int,  # returns from HOLD to ACTIVE, those long ago forgotten
    calm=int,  # cycles in ACTIVE since one was forgotten
    held=int,  # cycles in HOLD since the correction acted last, those before a ramp that was broken off included
    ending=int,  # 1: asked to end: HOLD leads to the ramp or to FAULT, never back
)
"""State of :func:`counterflex.runtime.state.supervisor.supervise`."""

SUPERVISED: Final = record(
    telegram=int,  # 1: a valid telegram came in this cycle
    healthy=int,  # 1: telegrams, sensors and self-tests are good enough to be READY
    arm=int,  # 1: the operator's edge
    enable=int,  # 1: the robot program wants the correction
    stop=int,  # 1: the operator's or robot's stop
    reset=int,  # 1: the operator's edge: out of FAULT, or a feed hold acknowledged
    soft=int,  # cause of a hold, or 0
    hard=int,  # cause of a fault, or 0
    at_zero=int,  # 1: the output is zero and at rest
    stands=int,  # 1: the commanded pose, correction aside, does not move
    away=int,  # 1: the correction is away although the program is in the cut, or wants it again
    in_cut=int,  # 1: material is cut here, or it may be
)
"""Inputs of the supervisor in a cycle."""

STATE: Final = record(
    correction=(float, 6),  # sent, m and rotation vector, part axes
    correction_rate=(float, 6),  # its change per second
    place=(float, 2),  # on the plan: row, and fraction of the segment that begins there; row -1 is unknown
    plan_share=float,  # of the plan in pilot control
    scale=(float, 3),  # learnt factors of the force
    scale_variance=(float, 3),
    predicted_before=(float, 6),  # predicted wrench, filtered, of the last cycle
    integral=(float, 3),
    deflection_before=(float, 3),  # of the last cycle
    offset=(float, 6),  # deviation that force and plan do not explain
    offset_variance=(float, 2),
    tracker_integral=(float, 6),  # of the published and of the designed tracker control
    answer_filter=(float, 24),  # memory of the robot's answer
    target=(float, 6),  # correction that the limiter moves to
    in_effect=(float, 6),  # correction in effect as the observer computes it
    fusion=FUSION,
    clock=float,  # cycles of the controller since the start, lost ones counted
    reference=(float, 6),  # force that stands for the plan's where there is none
    past_bent=(float, 18),  # PAST.bent of the time of a sample
    residual=(float, 6),  # deviation less the correction in effect
    swing=float,  # by how much the arm may swing about where it should stand, m
    notch_filter=(float, 12),  # memory of the designed controller's filter, two numbers per component
    notch_output=(float, 6),  # deviation behind it
    path_rate=(float, 6),  # speed of the commanded pose
    path_acceleration=(float, 6),
    known_ahead=(float, 6),  # correction known ahead of any measurement
    inertia_filter=(float, 24),  # memory of the low-pass SETTINGS.inertia for the predicted force
    speed=float,  # share of the programmed speed that the loop asks for
    force_at_speed=float,  # share of the predicted force at that speed
    lag_filter=(float, 12),  # memory of the filter of lag_correction
    past=PAST,  # cycle of the time of a sample
    earlier=PAST,  # a second one
    sweep=(float, 4),  # search for the place on the path while nobody is on the way
    axes=(float, 6),  # the correction as axis angles that could be computed last
    bumpless=(float, 6),  # correction held before less the wanted one; ramps to nothing
    idle_torque=(float, 12),  # axis torque from the currents without a cut, in positive and negative direction
    idle_cycles=(float, 12),  # over which it was averaged
    presliding=(float, 12),  # of motors and links, -1 .. 1
    angles_before=(float, 12),  # of motors and links, rad
    has_angles=float,  # 1: there are any
    idle=(float, 6),  # axis torque without a cut, as the axes move now
    torque_residual=(float, 6),  # axis torque less that of the measured force
    motor=(float, 6),  # angles of the motors, corrected, rad
    link=(float, 6),  # angles of the links, under the predicted force, rad
    preview=(float, 6),  # force that the plan expects when a correction sent now acts
    predicted_late=(float, 6),  # predicted force that a measured one is compared with, before the filters
    believed=(float, 6),  # force that the step takes for the measured one
    supervisor=SUPERVISOR,
    ring_row=int,  # of PAST, to be written in this cycle
    cycles=int,  # since the start
    telegrams_lost=int,  # in a row
    inputs=SUPERVISED,
    another_session=int,  # 1: another session of the controller came, and its fault has not been reset
    disbelieved=int,  # tracker samples in a row that were too far off
    disabled=int,  # telegrams in a row in which the program did not want the correction
    enabled=int,  # telegrams in which it did, since it was armed or the correction acted
    acted=int,  # 1: the correction has acted since a person last acknowledged
    away=int,  # 1: it is away in the cut, or wanted again without having been armed
    armed=int,  # 1: it was armed and has not acted since, nor has a person acknowledged
    uncorrected=int,  # telegrams in a row in which the program moved in the cut and should have been corrected
)
"""State of the step, SI, part axes."""
