"""Settings of the online step: numbers and modes that a run does not change."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record

SUPERVISION: Final = record(hold=int, good=int, rise=int, stop=int, returns=int, calm=int)
"""Cycles of :class:`counterflex.runtime.state.supervisor.SupervisorSettings`."""

SETTINGS: Final = record(
    period=float,  # of a cycle, s
    lead=float,  # s by which the plan is read ahead
    threshold=float,  # N, difference of forces above which the plan is blended in
    blend=float,  # change of the share per cycle
    contained=float,  # 1 where the program contains the correction of the predicted deflection, else 0
    reference_late=float,  # s by which the force that stands for the plan's is known late; 0 with a plan
    follow=float,  # s by which the robot trails its programmed path
    translation=(float, 3),  # radius, speed, acceleration
    rotation=(float, 3),
    ramp=(float, 3),  # limits of translation while ramping out
    ramp_rotation=(float, 3),
    hard_factor=float,  # of the radius, beyond which a wanted correction is a fault
    scale=(float, 4),  # tuning of learn_scale
    gain=float,  # of the tracker's integrator, per cycle
    saturation=(float, 2),  # m, rad
    drift=(float, 2),  # variance of the observer per cycle, m2, rad2
    noise=(float, 2),  # variance of a tracker's sample, m2, rad2
    largest_jump=float,  # m, deviation beyond which a sample is not believed
    off_path=float,  # m
    answer=(float, 5),  # robot_answer
    R_base_part=(float, 9),  # by rows; where the robot holds the part, see R_base_tcp
    R_base_tcp=(float, 9),  # of the spindle that stands
    fusion=(float, 9),  # FusionTuning.packed
    tracker_late=float,  # s, where a sample does not say it
    gains=(float, 9),  # feed, across, along the tool: Kp, Ki times the period, Kd by the period
    proportional=float,  # of the designed tracker controller
    notch=(float, 5),  # its filter, b0 b1 b2 a1 a2
    inertia=(float, 5),  # low-pass that the measured force has passed before
    lag=(float, 8),  # filter of lag_correction
    lag_most=float,  # its largest translation, m
    swing=(float, 2),  # 1 by the square of the lowest mode, s2; share of a swing that remains after a cycle
    torque_variance=(float, 6),  # of each axis torque from motor currents
    torsion=(float, 6),  # compliance of each axis about itself, rad/(N m)
    preview=float,  # how long before it acts a correction is sent, s
    holds_part=int,  # 1: the robot holds the part against a spindle that stands
    force=int,  # ForceMode
    tracker=int,  # TrackerMode
    compensated=int,
    normal_only=int,
    orientation=int,
    has_plan=int,
    stale=int,  # age at which a force or a tracker is stale, cycles
    lost=int,  # telegrams in a row
    nominal_back=int,  # cycles back to the nominal pose that a tracker sample belongs to
    correction_back=int,  # cycles back to the correction whose answer it shows
    deflection_back=int,
    window=int,  # segments of the plan that are looked at ahead
    tracker_stale=int,
    disbelieved=int,  # samples in a row
    undo_lag=int,  # 1: undo the lag behind the program
    undo_play=int,  # 1: send the correction of the plan that undoes play
    bridge=int,  # age of a force up to which the plan alone goes on
    reported_back=int,  # cycles back to the nominal pose that a reported one belongs to
    reads_ahead=int,  # 1: the plan says itself what to command ahead of time
    tracker_lost_holds=int,  # 1: a tracker that is not relied on any more holds; 0: its part stands still
    force_offset=int,  # what follows a step of the force: ForceOffset
    supervisor=SUPERVISION,
)
"""Constants and modes of the step, SI."""
