"""Places of the monitor's numbers in its arrays, and the names of what it watches for."""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class Event(IntEnum):
    """What the monitor watches for; bit ``1 << event`` in its results."""

    MISSING_CUT = 0
    """Material should be cut and there is no force."""
    OVERLOAD = 1
    """More force than the plan explains, or than spindle and tool may take."""
    WEAR = 2
    """The ratio of measured to predicted force rises with the length of cut."""
    BREAKAGE = 3
    """The force drops at once where the plan is steady."""
    CHATTER = 4
    """Vibration that does not turn with the spindle."""
    LOW_CHATTER = 5
    """Vibration at the frequencies of the arm and the correction that does not die away in a steady cut."""


EVENTS: Final = len(Event)

# What the fast samples of a cycle say, float64; given.
F_SAMPLES: Final = 0  # taken in this cycle
F_RESIDUAL: Final = 1  # root mean square of what is neither slow nor a harmonic of the spindle, N
F_TURN: Final = 2  # amplitude once per turn of the spindle, N
F_TOOTH: Final = 3  # amplitude at the tooth passing frequency or its alias, N
F_READY: Final = 4  # 1: the three above have settled
F_SEPARATE: Final = 5  # 1: once per turn can be told from the tooth passing and its harmonics
F_SLOWER: Final = 6  # root mean square of what lies about the corner of the high-pass and below, N
FAST: Final = 7

# The plan, row by row, float64.
P_TIME: Final = 0  # planned time, s
P_DISTANCE: Final = 1  # along the path from its start, m
P_FORCE: Final = 2  # 3: predicted force as the sensor sees it now, part axes, N
P_LOW: Final = 5  # least force that the place may have, N
P_HIGH: Final = 6  # largest, N
P_STEADY: Final = 7  # 1: neither size nor direction of the force change about here
P_TURN: Final = 8  # turns of the spindle per second
P_TEETH: Final = 9
P_DROP: Final = 10  # share of the mean force that is lost with one tooth
P_TOOL: Final = 11  # number of the tool
P_SPEED: Final = 12  # largest share of the programmed speed at which the path stays within tolerance
P_COLUMNS: Final = 13

# Constants, float64.
C_PERIOD: Final = 0
C_KEEP: Final = 1  # of the force filters, per cycle
C_NOISE: Final = 2  # noise of the filtered force at rest, N, at least
C_FAST_NOISE: Final = 3  # root mean square of the fast residual at rest, N, at least
C_Z: Final = 4  # noise: standard deviations of a false alarm
C_MODEL: Final = 5  # model: largest relative error that is not alarmed
C_MARGIN: Final = 6  # N
C_LIMIT_N: Final = 7  # inf: not limited
C_LIMIT_NM: Final = 8
C_MISSING: Final = 9  # m of cut without force
C_BIN: Final = 10  # m of cut per ratio
C_CUSUM: Final = 11  # decision interval
C_RISE: Final = 12  # least rise
C_CHATTER: Final = 13  # share of the mean force that may be broad-band
C_QUANTILE: Final = 14  # of the energy of the residual, noise alone
C_EXPONENT: Final = 15  # of the force in the feed
C_OFF_PATH: Final = 16
C_LEAST: Final = 17  # force that tells a ratio, N
C_INERTIA: Final = 18  # mass behind the sensor whose inertia it feels, kg
C_LOW_CHATTER: Final = 19  # share of the mean force that may be slow vibration
C_TREND: Final = 20  # standard normal value that a trend must reach
CONSTANTS: Final = 21

# Choices, int64.
W_PLAN: Final = 0
W_REACTION: Final = 1  # EVENTS
W_CYCLES: Final = W_REACTION + EVENTS  # cycles for which overload, breakage, chatter, low chatter must last: 4
W_SETTLE: Final = W_CYCLES + 4  # cycles of steady cut before a drop can be seen
W_CLEAR: Final = W_SETTLE + 1  # cycles without the condition before an event may come again
W_STALE: Final = W_CLEAR + 1
CHOICES: Final = W_STALE + 1

# State, float64.
S_FORCE: Final = 0  # 6: filter of the measured force, two stages, part axes
S_EXPECTED: Final = 6  # 6: of the predicted one
S_SIZE: Final = 12  # 2: of the size of the measured force
S_LOW: Final = 14  # 2
S_HIGH: Final = 16  # 2
S_FEED: Final = 18  # 3: last feed direction
S_ACROSS: Final = 21  # 3: last direction across
S_LAST_TIME: Final = 24  # plan time of the last cycle
S_RATE: Final = 25  # speed by programmed speed, filtered
S_LAST_DISTANCE: Final = 26
S_IDLE: Final = 27  # mean square of the filtered size out of the cut, the tool moving evenly
S_IDLE_FAST: Final = 28  # mean square of the fast residual out of the cut
S_BLIND: Final = 29  # m of cut without force
S_RATIO: Final = 30  # reference of the ratio in this steady stretch
S_RATIO_VARIANCE: Final = 31
S_TURN: Final = 32  # reference of the amplitude once per turn by force
S_TURN_VARIANCE: Final = 33
S_CUT: Final = 34  # m of cut
S_BIN: Final = 35  # 3: measured times predicted, predicted squared, m in the open bin
S_CUSUM: Final = 38
S_CLASS: Final = 39  # CLASSES x 6: n, mean cut, mean ratio, Sxx, Sxy, Syy
CLASSES: Final = 8
CLASS: Final = 6
S_SERIAL: Final = S_CLASS + CLASSES * CLASS  # 4: last residual, sum of products of neighbours, of squares, count
S_PEAK: Final = S_SERIAL + 4  # largest recent force
S_PLACE: Final = S_PEAK + 1  # 3: commanded place of the last cycle, correction included
S_VELOCITY: Final = S_PLACE + 3  # 6: its velocity, two stages of the force filter
S_MOVED: Final = S_VELOCITY + 6  # largest recent acceleration, m/s^2
S_SWUNG: Final = S_MOVED + 1  # 2: mean square of the force out of the cut after accelerations, and of S_MOVED then
S_LEVEL: Final = S_SWUNG + 2  # 3: slow mean of measured minus predicted force
S_SLOW: Final = S_LEVEL + 3  # mean square of what is left of it
STATE: Final = S_SLOW + 1

# State, int64.
N_COUNT: Final = 0  # EVENTS: cycles that a condition has lasted
N_GONE: Final = N_COUNT + EVENTS  # EVENTS: cycles since it was last there
N_ON: Final = N_GONE + EVENTS  # bits of the events that are on
N_HOLD: Final = N_ON + 1  # cause of a feed hold asked for, until reset
N_STOP: Final = N_ON + 2  # cause of a stop asked for, until reset
N_STEADY: Final = N_ON + 3  # cycles of steady cut
N_IDLE: Final = N_ON + 4  # cycles learnt out of the cut, moving evenly
N_TOOL: Final = N_ON + 5
N_STARTED: Final = N_ON + 6
N_IDLE_FAST: Final = N_ON + 7
N_DOUBT: Final = N_ON + 8
N_SWUNG: Final = N_ON + 9  # cycles learnt out of the cut, after accelerations
N_PLACED: Final = N_ON + 10  # 1: S_PLACE is known
WHOLE: Final = N_ON + 11

# Results, float64.
R_FORCE: Final = 0  # 3: measured, feed frame, filtered, N
R_EXPECTED: Final = 3  # 3: predicted through the same filter
R_SIZE: Final = 6  # filtered size of the measured force
R_LEAST: Final = 7  # force below which a cut counts as missing, where it can be told; else 0
R_MOST: Final = 8  # force above which it is an overload
R_RATIO: Final = 9  # measured by predicted; 0 where it is not known
R_VALUE: Final = 10  # EVENTS: what is watched, by event
R_LIMIT: Final = R_VALUE + EVENTS  # EVENTS: its limit; 0 while an event cannot be seen
R_TREND: Final = R_LIMIT + EVENTS  # change of the ratio per metre of cut
R_TREND_SIGMA: Final = R_TREND + 1
R_RISE: Final = R_TREND + 2  # of the ratio since the first cut, by the trend
R_TREND_DEGREES: Final = R_TREND + 3  # degrees of freedom of its standard deviation
R_CUT: Final = R_TREND + 4  # m of cut so far
R_DISTANCE: Final = R_TREND + 5  # m along the program
R_RATE: Final = R_TREND + 6  # speed by programmed speed, measured
R_SPEED: Final = R_TREND + 7  # share of the programmed speed asked for
RESULTS: Final = R_TREND + 8

# Results, int64.
O_ON: Final = 0  # bits of the events that are on
O_NEW: Final = 1  # bits of those that came in this cycle
O_SEEN: Final = 2  # bits of those that could be seen in this cycle
O_SLOWED: Final = 3  # why the speed is lowered, see Slowed
OUTCOME: Final = 4


class Slowed(IntEnum):
    """Why less than the programmed speed is asked for."""

    NOT = 0
    PLAN = 1
    """The correction could not follow within tolerance."""
    LIMITER = 2
    """The correction is held back by its limits of speed and acceleration."""
    REACH = 3
    """The correction comes near its largest value."""
    FORCE = 4
    """The force comes near its limit."""
