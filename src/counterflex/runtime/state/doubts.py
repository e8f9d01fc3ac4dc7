"""Limits of the plausibility tests, and what they remember from one cycle to the next."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record

LIMITS: Final = record(
    least_m=float,  # below it neither correction nor deviation says anything
    answer_share=float,  # of the correction that may be missing or too much
    follow_late_s=float,  # likewise its path, where the path turns
    growth=float,  # residual by what it was at the start
    against=float,  # share of the correction's change by which the residual may grow against it
    frame_m=float,
    frame_rad=float,
    return_m=float,
    cosine=float,  # of the largest angle between measured and predicted force
    force_n=float,  # least force that has a direction
    idle_n=float,
    idle_nm=float,
    period=float,  # s
    mirrored=float,  # share by which the residual's change may differ from the correction's mirrored one
    rejected_share=float,  # share of a tracker's last samples that may be rejected
    tracker_late=float,  # s, age of a tracker's sample that does not say it
    step_n=float,  # N, step of the residual of the force
    step_plan=float,  # share of a change of the planned force that swings on
    step_fade=float,  # share of a swing of the arm that remains after a cycle
    step_torque=float,  # of the variances of the axis torque: of a single sample
    step_memory=float,  # share of a change of the residual that remains after a cycle
    early_m=float,  # distance to the nearest answer that is soon a fault
    early_share=float,  # of that answer
    load_share=float,  # of a change of the deflection to which the drives may yield
    missing_m=float,  # lasting part of the correction that may be missing at the robot
    plan_m=float,  # lasting distance of the program from the plan in the cut
    plan_feed=float,  # share by which its speed may lastingly differ from the planned one
    plan_force=float,  # likewise the measured force from the predicted one
    settle_gain=float,  # share of a new sample in a mean over the time in which drives and arm settle
    answer_cycles=int,
    answer_late=int,  # cycles by which the robot may answer later than thought
    early_cycles=int,
    early_late=int,  # likewise, where it is soon a fault
    settle_cycles=int,  # cycles behind a stop of the programmed point in which nothing is judged
    residual_cycles=int,
    gap_cycles=int,  # without a sample after which the return is checked, see gap_cycles
    return_samples=int,  # in a row that must agree
    direction_cycles=int,
    idle_cycles=int,
    window=int,  # cycles over which changes of residual and correction are compared
    sign_samples=int,  # in a row that mirror the correction; 0: not judged
    share_samples=int,  # over which the share of rejected ones is kept
    silent_cycles=int,  # without a believed sample after which the tracker is lost
    step_few=int,  # samples of the force in which a step shows
    step_period=int,  # cycles of the arm's lowest mode
    step_long=int,  # cycles over which a slower step is looked for
    step_back=int,  # cycles after which it is over
    settled=int,  # cycles after a cut until the force filters have forgotten it
)
"""Limits, SI, and times in cycles."""

CUT: Final = record(residual=(float, 6), planned=(float, 3), way=float)
"""Measured less planned force, N and N m; planned force, N; way of the tool in a few cycles, m."""
SAMPLE: Final = record(cut=CUT, torque=(float, 6), change=float, ringing=float)
"""Force before the filters and torque of the axes; change of the residual, and the fading largest of those before."""
CUT_KIND: Final = record(cut=CUT, feed=(float, 3), seen=float)
"""A kind of cut: means in feed axes, direction of feed, and how many periods it was seen."""
DEVIATION: Final = record(deviation=(float, 3), in_effect=(float, 3))
"""Deviation that the tracker shows, and correction in effect then, m."""

WINDOW_MOST: Final = 64
STEP_MOST: Final = 256
CALM_MOST: Final = 16

MEMORY: Final = record(
    standing=(float, 3),  # reported minus commanded while nothing is corrected and the robot stands
    start=float,  # residual before the correction acted
    expected=float,  # largest expected deflection, fading
    deviation=(float, 3),  # last believed one
    model=(float, 3),  # correction in effect plus expected deflection then
    deviations=(DEVIATION, WINDOW_MOST),  # of the last cycles
    force=(float, 6),  # last wrench that was numbers
    pose=(float, 12),  # last sample as it came
    stood=(float, 6),  # commanded position and correction in effect then
    turn=(float, 3),  # orientation of the last believed deviation
    clock=float,  # when it was measured, cycles of the controller
    late=float,  # how late it came, s
    rejected_share=float,  # of the last samples
    pause=float,  # usual cycles without a sample between two; 0 where one comes in every cycle
    samples=(SAMPLE, STEP_MOST),  # of the force
    cut_before=CUT,  # means before the step
    plan_change=float,  # by how much the planned force has changed recently, fading, N
    swing_n=float,  # likewise the largest force of inertia
    force_size=float,  # likewise the largest measured force
    residual_change=float,  # likewise by how much the residual has changed
    noise=float,  # variance of a sample, by what changes from one to the next
    torque_now=(float, 6),  # work space: mean torques of the axes
    torque_then=(float, 6),  # work space: before the change
    torque_expected=(float, 6),  # work space: of the change
    kinds=(CUT_KIND, CALM_MOST),  # what calm cuts have shown
    calm_sum=CUT,  # of the period that is running
    calm_planned=(float, 3),  # planned force with which it began
    calm_way=float,  # way with which it began
    calm_spread_n=float,  # largest difference from that force
    calm_spread_way=float,  # likewise from that way
    calm_last=CUT,  # means of the period before
    differing=CUT,  # the cut that was reported
    differing_feed=(float, 3),  # its direction of feed
    heading=(float, 3),  # direction of motion of the programmed point, 0 where it stands
    bend=float,  # by how much the last bends of the path may throw the robot off, m
    bent=(float, 3),  # mean of the deflection
    missing=(float, 3),  # mean of what is missing of the correction at the robot, m
    # Sample of the tracker that the next are held against, commanded position then; 1: there is one, < 0: cycles until
    # one may be taken.
    anchor=(float, 7),
    plan_place=float,  # mean distance of the program from the plan in the cut, m
    plan_feed=float,  # mean speed by the planned one
    plan_force=float,  # mean measured by predicted force
    plan_soft=int,  # cause of a hold by these, while the correction acts
    plan_cycles=int,  # cycles in the cut over which these are
    answer=int,
    early_answer=int,
    short=int,  # 1: what is missing is reported
    still=int,  # cycles since the programmed point stopped
    residual=int,
    frame=int,  # 1: the last sample was beyond the limits of the frame test
    unseen=int,  # cycles without a sample
    waiting=int,  # 1: after a gap, no sample has been believed yet
    agreed=int,
    direction=int,
    idle=int,
    window_row=int,  # of `deviations`
    window_filled=int,
    air=int,  # cycles since the plan last cut
    known=int,  # 1: a sample has been believed
    soft=int,  # causes for the next cycle
    hard=int,
    early=int,  # doubts found before the step
    sign=int,
    rejected=int,  # samples of the tracker that were rejected, in all
    why=int,  # cause of the last one, 0 once one has been believed
    without=int,  # cycles since one was believed
    same=int,  # samples in a row that repeat the one before although the tool moves
    paused=int,  # cycles since a sample came, believed or not
    step=int,  # 1: the force is suspected of a step, 2: reported
    step_since=int,
    step_back=int,
    sample_row=int,  # of `samples`
    samples_filled=int,
    step_even=int,  # cycles since plan or speed changed
    calm=int,  # samples of the period that is running
    calm_long=int,  # calm periods in a row
    calm_off=int,  # of them off what such cuts have shown before
    calm_rows=int,  # kinds that are known
    calm_told=int,  # 1: reported
    calm_air=int,  # cycles in air since, in which the sensor shows nothing
)
"""What the tests remember; counters count cycles or samples in a row unless they say otherwise."""

WORK: Final = record(
    one=(float, 14),
    two=(float, 14),
    fresh=CUT,  # means of a few samples
    period_mean=CUT,  # means of a period
    feed=(float, 9),  # rows: unit vectors along the feed, across it, along the tool
    now=CUT_KIND,  # calm period that has ended
    answer=(float, 16),
)
"""Work space of a cycle; nothing in it is remembered."""
