"""Records of process monitoring: the plan as it needs it, its settings, what it remembers and what it found.

SI units. The words of :data:`MEMORY` stand in the order in which logs that do not say their layout have them.
"""

from __future__ import annotations

from typing import Any, Final

from counterflex.core.records import record
from counterflex.runtime.monitoring.events import EVENTS
from counterflex.runtime.state.chosen import SETTINGS as LOOP_SETTINGS
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.planned import PLAN
from counterflex.runtime.state.result import RESULT

HARMONICS: Final = 16
"""Lines of the force that are followed."""
CLASSES: Final = 8
"""Classes of force among which ratios are compared."""

PLAN_ROW: Final = record(
    time=float,  # planned time, s
    distance=float,  # along the path from its start, m
    force=(float, 3),  # predicted force as the sensor sees it now, part axes, N
    lowest=float,  # least force that the place may have, N
    highest=float,  # largest, N
    steady=float,  # 1: neither size nor direction of the force change about here
    turn_per_s=float,  # turns of the spindle per second
    teeth=float,
    lost_tooth=float,  # share of the mean force that is lost with one tooth
    tool=float,  # its number
    speed=float,  # largest share of the programmed speed at which the path stays within tolerance
)
"""One row of the plan."""

SETTINGS: Final = record(
    period=float,  # cycle, s
    keep=float,  # of the force filters, per cycle
    noise=float,  # noise of the filtered force at rest, N, at least
    fast_noise=float,  # root mean square of the fast residual at rest, N, at least
    noise_z=float,  # standard deviations of noise of a false alarm
    model_error=float,  # largest relative error of the model that is not alarmed
    margin=float,  # N
    force_limit=float,  # N; inf: not limited
    moment_limit=float,  # N m; inf: not limited
    missing_length=float,  # m of cut without force
    bin_length=float,  # m of cut per ratio
    cusum_interval=float,  # decision interval
    least_rise=float,  # of the ratio
    chatter_share=float,  # share of the mean force that may be broad-band
    energy_quantile=float,  # of the energy of the residual, noise alone
    exponent=float,  # of the force in the feed
    off_path=float,  # distance from the plan at which it is not believed, m
    least_force=float,  # that tells a ratio, N
    inertia_mass=float,  # behind the sensor, whose inertia it feels, kg
    low_chatter_share=float,  # share of the mean force that may be slow vibration
    trend_z=float,  # standard normal value that a trend must reach
    planned=int,  # 1: there is a plan
    reaction=(int, EVENTS),  # what an event does
    overload_cycles=int,  # for which an overload must last
    breakage_cycles=int,
    chatter_cycles=int,
    low_chatter_cycles=int,
    settle_cycles=int,  # of steady cut before a drop can be seen
    clear_cycles=int,  # without the condition before an event may come again
    stale_cycles=int,  # age of a force that is not judged any more
    least_speed=float,  # least share of the programmed speed; 1 leaves the speed alone
    speed_step=float,  # largest change of the share per cycle
    largest_correction=float,  # m
    sample_period=float,  # of the force sensor, s
    energy_time=float,  # memory of the energy of its fast samples, s
    filter_time=float,  # time constant of a stage of the force filters, s
)
"""What the monitor is set to."""

FAST: Final = record(
    samples=float,  # taken in this cycle
    residual=float,  # root mean square of what is neither slow nor a harmonic of the spindle, N
    turn=float,  # amplitude of the orders of the spindle that are none of the tooth passing, N
    tooth=float,  # amplitude of the tooth passing and its harmonics, N
    ready=float,  # 1: the three above have settled
    separate=float,  # 1: the two can be told apart; 2: and their pattern compared by its phases
    slower=float,  # root mean square of what slow force and a spindle off its speed leave in the residual, N
    change=float,  # amplitude of the change of the orders between from the remembered pattern, N; -1: not known
)
"""What the fast samples of a cycle say; given to the other detectors."""

RESULTS: Final = record(
    force=(float, 3),  # measured, feed frame, filtered, N
    expected=(float, 3),  # predicted through the same filter
    force_size=float,  # filtered size of the measured force
    least=float,  # force below which a cut counts as missing, where it can be told; else 0
    most=float,  # force above which it is an overload
    ratio=float,  # measured by predicted; 0 where it is not known
    value=(float, EVENTS),  # what is watched, by event
    limit=(float, EVENTS),  # its limit; 0 while an event cannot be seen
    trend=float,  # change of the ratio per metre of cut
    trend_sigma=float,  # its standard deviation
    rise=float,  # of the ratio since the first cut, by the trend
    trend_degrees=float,  # degrees of freedom of trend_sigma
    cut=float,  # m of cut so far
    distance=float,  # m along the program
    rate=float,  # speed by programmed speed, measured
    speed=float,  # share of the programmed speed asked for
)
"""What the monitor found, numbers."""

OUTCOME: Final = record(
    on=int,  # bits of the events that are on
    new=int,  # bits of those that came in this cycle
    seen=int,  # bits of those that could be seen in this cycle
    slowed=int,  # why the speed is lowered, see Slowed
)
"""What the monitor found, bits."""

REFERENCE: Final = record(
    ratio=float,
    ratio_variance=float,
    turn=float,  # amplitude between the tooth passing by predicted force
    change=float,  # mean change of the pattern by predicted force
    change_variance=float,
    force=(float, 3),  # predicted, tool axes, N
)
"""Values of the steady cut so far, to which the present ones are compared."""

FORCE_CLASS: Final = record(
    number=float,  # of ratios
    cut=float,  # mean length of cut, m
    ratio=float,  # mean
    cut_cut=float,  # sum of the squares of the deviations of the length of cut
    cut_ratio=float,  # of the products
    ratio_ratio=float,  # of the squares of those of the ratio
)
"""Ratios of cuts of about the same force."""

NEIGHBOURS: Final = record(last=float, products=float, squares=float, pairs=float)
"""Last residual of the regression; sum of the products of neighbours and of the squares; number of pairs."""

WEAR: Final = record(
    cut=float,  # m of cut
    bin_product=float,  # open bin: measured times predicted, summed over m
    bin_square=float,  # predicted squared
    bin_length=float,  # m
    cusum=float,
    classes=(FORCE_CLASS, CLASSES),
    neighbours=NEIGHBOURS,
)
"""What is remembered of a tool."""

NOW: Final = record(
    frame=(float, 9),  # feed frame, rows along the feed, across, normal to both
    force=(float, 3),  # predicted force of this cycle, part axes
    lowest=float,  # its bounds
    highest=float,
    predicted=float,  # its filtered size
    ratio=float,
)
"""Of this cycle alone."""

SAMPLES: Final = record(
    high_pass=(float, (3, 2)),  # axis, stage
    slower=(float, 3),  # third low-pass
    lines=(float, (3, 2 * HARMONICS)),  # axis; cosine and sine amplitude of each line
    before=(float, (3, 2 * HARMONICS)),  # the same a cycle ago
    energy=float,  # of the residual, N^2
    slower_energy=float,
    turn=float,  # commanded turns of the spindle per sample
    slip=float,  # share by which the spindle turns faster than commanded
    strength=float,  # squared amplitude of all lines a cycle ago, N^2
    turning=float,  # speed of the spindle beside the one that is followed, filtered, rad/s
    alias=float,  # root mean square of what lines leave in the mean force of a cycle, N; inf: not known
    slow=float,  # the part of it of harmonics that fold below the high-passes, where it is known
    angle=float,  # of the spindle, turns
    period=float,  # of the samples, s
    order=(float, HARMONICS),  # of each line
    active=(float, HARMONICS),  # 1: it is followed
    place=(float, HARMONICS),  # turns per sample that it folds to
    gain=(float, HARMONICS),  # its squared amplitude by that behind the high-passes
    seen=(float, HARMONICS),  # 1: its amplitude counts
    clear=(float, HARMONICS),  # samples since which it lies off all others
    pattern=(float, (3, 2 * HARMONICS)),  # remembered lines of the steady cut, turned to the present angle
    square=(float, HARMONICS),  # remembered squared amplitude of each line
    mixed=(float, HARMONICS),  # time for which the phase of each line is not taken for its own, s
    known=(float, HARMONICS),  # cycles over which each line of it was averaged
    wave=(float, 2 * HARMONICS),  # cos and sin of each line, this sample
    step=(float, 2 * HARMONICS),  # of the angle from sample to sample
    teeth=int,
    settled=int,  # samples since a gap or another speed
    following=int,  # sequence number of the next sample
    in_cut=int,  # 1: lines were strong enough to follow the speed since they were chosen
    matched=int,  # 1: the angle of the pattern is known, else up to the tooth
)
"""What is remembered of the force sensor's own samples."""

MEMORY: Final = record(
    fast=FAST,
    results=RESULTS,
    outcome=OUTCOME,
    force=(float, (3, 2)),  # filter of the measured force, two stages, part axes
    expected=(float, (3, 2)),  # of the predicted one
    force_size=(float, 2),  # of the size of the measured force
    lowest=(float, 2),  # of the bounds of the predicted one
    highest=(float, 2),
    directions=(float, 6),  # last feed direction, last direction across
    last_time=float,  # plan time of the last cycle, s
    rate=float,  # speed by programmed speed, filtered
    last_distance=float,  # m
    idle=float,  # mean square of the filtered size out of the cut, the tool moving evenly
    idle_fast=float,  # mean square of the fast residual out of the cut
    without_force=float,  # m of cut
    reference=REFERENCE,
    wear=WEAR,
    peak=float,  # largest recent force
    risen=float,  # amplitude that lines between the tooth passing have gained in a steady stretch, N
    onset=float,  # largest recent change of the force within the time constant of the notches, N
    place=(float, 3),  # commanded place of the last cycle, correction included
    velocity=(float, (3, 2)),  # its velocity, two stages of the force filter
    acceleration=float,  # largest recent one, m/s^2
    swing_force=float,  # mean square of the force out of the cut after accelerations
    swing_acceleration=float,  # and of the acceleration then
    level=(float, 3),  # slow mean of measured minus predicted force
    slow=float,  # mean square of the rest
    lasted=(int, EVENTS),  # cycles that a condition has lasted
    gone=(int, EVENTS),  # cycles since it was last there
    events=int,  # bits of the events that are on
    hold_cause=int,  # of a feed hold asked for, until reset
    stop_cause=int,  # of a stop asked for, until reset
    steady_cycles=int,  # of steady cut at a stretch
    known_cycles=int,  # of steady cut like the present one, gaps left out
    less_cycles=int,  # of a drop
    calm=int,  # 1: steady cut without a suspicion, whose pattern is remembered
    idle_cycles=int,  # learnt out of the cut, moving evenly
    tool=int,
    started=int,
    idle_fast_cycles=int,
    doubtful_cycles=int,  # in which the ratio was lower and it was no event
    swing_cycles=int,  # learnt out of the cut, after accelerations
    placed=int,  # 1: place is known
    speed=float,  # share of the programmed speed asked for
    busy=float,  # share of the last cycles in which the limiter held the correction back
    now=NOW,
    samples=SAMPLES,
)
"""What the monitor remembers from one cycle to the next, with what it found."""

MONITOR_TYPES: Final[dict[str, Any]] = {
    "Settings": SETTINGS,
    "Memory": MEMORY,
    "PlanRow": PLAN_ROW,
    "Samples": SAMPLES,
    "Wear": WEAR,
    "Given": GIVEN,
    "Loop": LOOP_SETTINGS,
    "Plan": PLAN,
    "Result": RESULT,
}
"""Types of records by the names in signatures of the monitor's kernels; the last four are the loop's."""
