"""Places of inputs and results of the step in the plain views of them that process monitoring reads."""

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
