"""Places of the step's numbers in its arrays: inputs, constants, state, output."""

from __future__ import annotations

from typing import Final

# Inputs of a cycle, float64.
G_NOMINAL: Final = 0  # 12: rotation by rows, position m: commanded pose without correction, part frame
G_Q: Final = 12  # 6: axis angles, rad
G_W: Final = 18  # 6: wrench of the process on the tool about the TCP, part axes, unfiltered
G_ACTUAL: Final = 24  # 12: measured pose of the tool, part frame
G_TRACKER_LATE: Final = 36  # s from the measurement of G_ACTUAL to now; below zero where not known
G_TRACKER_SIGMA: Final = 37  # m, of that measurement; 0 where not known
G_TORQUE: Final = 38  # 6: torque of the process about the axes, from motor currents, N m
G_REPORTED: Final = 44  # 12: pose that the controller itself reports, correction included, part frame
GIVEN: Final = 56

# Inputs of a cycle, int64.
F_ELAPSED: Final = 0  # cycles since the last telegram, 1 when none was lost; 0 for no telegram
F_FORCE_AGE: Final = 1  # cycles since the last good force
F_TRACKER_NEW: Final = 2  # 1: G_ACTUAL is new and good; 2: new, and not believed
F_TRACKER_AGE: Final = 3  # cycles since the last good tracker sample
F_HEALTHY: Final = 4
F_ARM: Final = 5
F_ENABLE: Final = 6
F_STOP: Final = 7
F_RESET: Final = 8
F_SOFT: Final = 9  # cause found outside of the step, or 0
F_HARD: Final = 10
F_SOURCES: Final = 11  # bits of Source: what this cell has
F_CURRENT_AGE: Final = 12  # cycles since the last good motor currents
F_REPORTED: Final = 13  # 1: G_REPORTED is there
FLAGS: Final = 14

# Constants, float64.
C_PERIOD: Final = 0
C_LEAD: Final = 1
C_THRESHOLD: Final = 2
C_BLEND: Final = 3  # change of the share per cycle
C_WITHOUT: Final = 4  # 1 where the program contains the correction of the predicted deflection, else 0
C_REFERENCE_LATE: Final = 5  # s by which the force that stands for the plan's is known late; 0 with a plan
C_FOLLOW: Final = 6  # s by which the robot trails its programmed path
C_TRANSLATION: Final = 7  # 3: radius, speed, acceleration
C_ROTATION: Final = 10  # 3
C_RAMP: Final = 13  # 3: limits of translation while ramping out
C_HARD: Final = 16
C_SCALE: Final = 17  # 4: tuning of learn_scale
C_GAIN: Final = 21
C_SATURATION: Final = 22  # 2: m, rad
C_DRIFT: Final = 24  # 2: variance per cycle, m2, rad2
C_NOISE: Final = 26  # 2: variance of a sample
C_JUMP: Final = 28
C_OFF_PATH: Final = 29
C_ANSWER: Final = 30  # 5: robot_answer
C_R_BASE_PART: Final = 35  # 9
C_RAMP_ROTATION: Final = 44  # 3
C_FUSION: Final = 47  # 9: FusionTuning.packed
C_TRACKER_LATE: Final = 56  # s, where a sample does not say it
C_KP: Final = 58  # 3: feed, across, along the tool
C_KI: Final = 61  # 3, times period
C_KD: Final = 64  # 3, by period
C_PROPORTIONAL: Final = 67  # of the designed tracker controller
C_NOTCH: Final = 68  # 5: its filter, b0 b1 b2 a1 a2
C_INERTIA: Final = 73  # 5: low-pass that the measured force has passed before
C_LAG: Final = 78  # 8: filter of lag_correction
C_LAG_MOST: Final = 86  # its largest translation, m
C_SWING: Final = 87  # 2: 1 by the square of the lowest mode, s2; what is left of a swing after a cycle
C_TORQUE: Final = 89  # 6: variance of each axis torque from motor currents
C_TORSION: Final = 95  # 6: compliance of each axis about itself, rad/(N m)
C_SOON: Final = 101  # how long before it acts a correction is sent, s
CONSTANTS: Final = 102

# Choices, int64.
W_FORCE: Final = 0
W_TRACKER: Final = 1
W_COMPENSATED: Final = 2
W_NORMAL: Final = 3
W_ORIENTATION: Final = 4
W_PLAN: Final = 5  # 1: there is a plan
W_STALE: Final = 6
W_LOST: Final = 7
W_NOMINAL_BACK: Final = 8  # cycles back to the nominal pose that a tracker sample belongs to
W_CORRECTION_BACK: Final = 9  # cycles back to the correction whose answer it shows
W_DEFLECTION_BACK: Final = 10
W_WINDOW: Final = 11
W_TRACKER_STALE: Final = 12
W_DISBELIEVED: Final = 13
W_LAG: Final = 14  # 1: undo the lag behind the program
W_PLAY: Final = 15  # 1: send the correction of the plan that undoes play
W_BRIDGE: Final = 16  # age of a force up to which the plan alone goes on
W_REPORTED_BACK: Final = 17  # cycles back to the nominal pose that a reported one belongs to
W_AHEAD: Final = 18  # column of the plan that is read ahead of time
W_TRACKER_LOST: Final = 19  # 1: a tracker that is not relied on any more holds; 0: its part stands still
W_FORCE_OFFSET: Final = 20  # what follows a step of the force: ForceOffset
CHOICES: Final = 21

# State, float64.
S_Y: Final = 0  # 6: correction sent, m and rotation vector, part axes
S_V: Final = 6  # 6: its change per second
S_PLACE: Final = 12  # 2
S_SHARE: Final = 14
S_SCALE: Final = 15  # 3
S_VARIANCE: Final = 18  # 3
S_BEFORE: Final = 21  # 6: predicted wrench, filtered, of the last cycle
S_INTEGRAL: Final = 27  # 3
S_LAST: Final = 30  # 3: deflection of the last cycle
S_OFFSET: Final = 33  # 6: deviation that force and plan do not explain
S_OFFSET_VARIANCE: Final = 39  # 2
S_SUM: Final = 41  # 6: integrator of the published tracker control
S_ANSWER: Final = 47  # 24: memory of the robot's answer, four rows of six
S_HELD: Final = 71  # 6: correction wanted
S_IN_FORCE: Final = 77  # 6: correction in effect as the observer computes it
S_FUSION: Final = 83  # 139: see fusion_kernel
S_CLOCK: Final = 222  # cycles of the controller since the start, lost ones counted
S_REFERENCE: Final = 223  # 6: force that stands for the plan's where there is none
S_PAST_BENT: Final = 236  # 18: bend of the time of a sample
S_REST: Final = 254  # 6: deviation less the correction in effect
S_SWING: Final = 260  # by how much the arm may swing about where it should stand, m
S_NOTCH: Final = 324  # 12: memory of the designed controller's filter, two numbers per component
S_FILTERED: Final = 336  # 6: deviation behind it
S_RATE: Final = 342  # 6: speed of the commanded pose
S_SECOND: Final = 348  # 6: its acceleration
S_FORWARD: Final = 354  # 6: correction known ahead
S_INERTIA: Final = 424  # 24: memory of the low-pass of C_INERTIA for the predicted force
S_SPEED: Final = 448  # share of the programmed speed that the loop asks for
S_SLOWER: Final = 449  # by which the predicted force is smaller at that speed
S_LAG: Final = 450  # 12: memory of the filter of lag_correction
S_PAST: Final = 462  # 68: row of the ring at the time of a sample
S_EARLIER: Final = 530  # 68: a second row of the ring
S_SWEEP: Final = 598  # 4: search for the place on the path while nobody is on the way
S_AXES: Final = 602  # 6: the correction as axis angles that could be computed last
S_BUMPLESS: Final = 608  # 6: what is left of the correction held before, above what is wanted; ramps to nothing
S_TORQUE: Final = 614  # 12: axis torque from the currents without a cut, in positive and negative direction
S_TORQUE_SEEN: Final = 626  # 12: cycles it was averaged over
S_TORQUE_WAY: Final = 638  # 25: presliding of motors and links, their last angles, and whether there are any
S_IDLE: Final = 663  # 6: axis torque without a cut, as the axes move now
S_BESIDE: Final = 669  # 6: axis torque less that of the measured force
S_MOTOR: Final = 675  # 12: angles of the motors and of the links, corrected and under the predicted force
S_SOON: Final = 687  # 6: force that the plan expects when a correction sent now acts
S_LATE: Final = 693  # 6: predicted force that a measured one is compared with, before the filters
S_BELIEVED: Final = 699  # 6: force that the step takes for the measured one
STATE: Final = 705

# State, int64: 0..10 of the supervisor, then
N_RING: Final = 11  # next row of the ring
N_CYCLES: Final = 12  # cycles since the start
N_LATE: Final = 13  # telegrams lost in a row
N_INPUTS: Final = 14  # 12: inputs of the supervisor
N_SESSION: Final = 26  # 1: another session of the controller came, and the fault it raised has not been reset
N_DISBELIEVED: Final = 27  # tracker samples in a row that were too far off
N_DISABLED: Final = 28  # telegrams in a row in which the program did not want the correction
N_ENABLED: Final = 29  # telegrams in a row in which it did
N_ACTED: Final = 30  # 1: the correction has acted since a person last acknowledged
N_AWAY: Final = 31  # 1: it is away in the cut, or wanted again without having been armed
N_ARMED: Final = 32  # 1: it was armed and has not acted since, nor has a person acknowledged
N_UNCORRECTED: Final = 33  # telegrams in a row in which the program moved in the cut although it was armed
WHOLE: Final = 34

RING_ROWS: Final = 256
RING_NOMINAL: Final = 0  # 12
RING_SENT: Final = 12  # 6
RING_DEFLECTION: Final = 18  # 6
RING_IN_FORCE: Final = 24  # 6: correction in effect
RING_CONTAINED: Final = 30  # 6
RING_FRAME: Final = 36  # 9: directions
RING_BENT: Final = 45  # 18: deflection under the predicted force along each
RING_CLOCK: Final = 63
RING_STAND: Final = 64  # 3: where the tool should stand, part frame
RING_SWING: Final = 67  # S_SWING
RING: Final = 68

# Results, float64.
R_CORRECTION: Final = 0  # 6: what to send, m and rotation vector, part axes
R_AXES: Final = 6  # 6: the same as change of the axis angles, rad
R_WRENCH: Final = 12  # 6: force the correction is computed from, part axes
R_PREDICTED: Final = 18  # 6: with lead
R_MEASURED: Final = 24  # 6: filtered
R_DEFLECTION: Final = 30  # 6: part axes
R_WANTED: Final = 36  # 6: correction before limits
R_DEVIATION: Final = 42  # 6: of the tracker
R_PATH: Final = 48  # distance from the path
R_SIGMA: Final = 49
R_CUT: Final = 50
R_FACTOR: Final = 51  # 3: measured by predicted force
R_MODEL: Final = 54  # 3: share of the deflection that the force does not explain
R_OFFSET: Final = 57  # 6: deviation that does not go with the force, m and rad, part axes
R_UNCERTAIN: Final = 63  # standard deviation of the expected deviation
R_SURPRISE: Final = 64  # 3: largest innovation by its standard deviation: force, tracker, currents; 0 without a sample
RESULTS: Final = 67

# Results, int64.
O_STATE: Final = 0
O_CAUSE: Final = 1
O_FEED_HOLD: Final = 2
O_STOP: Final = 3
O_SILENT: Final = 4
O_LIMITS: Final = 5  # bits of the limiter: translation, then rotation shifted by 4
O_ELASTIC: Final = 6  # bits of the elastic step
O_SOFT: Final = 7
O_HARD: Final = 8
O_SOURCES: Final = 9  # bits of Source: what the estimate rests on
O_DEGRADED: Final = 10  # cause for which a source of the cell is missing, or 0
O_DOUBT: Final = 11  # bits of :mod:`counterflex.runtime.plausibility.kernel`
O_REJECTED: Final = 12  # samples of the tracker that were rejected, in all
OUTCOME: Final = 13
