"""Play of the drives in axis-specific output, where corrections go past the controller's own compensation.

A controller that is given a Cartesian correction plans the axes itself and adds half the play of each gear in the
direction in which the axis moves. Axis corrections are added behind that (Haehn2020 section 3.3). So they must contain
it: half the play in the direction in which the motor really goes, program and correction together, less what the
controller adds for the program alone. The direction is that of a play operator a quarter of the play wide: an axis that
trembles about where it stands does not turn round.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.runtime.primitives.frames import all_finite
from counterflex.runtime.state import layout as at
from counterflex.runtime.state.supervisor import State

# Columns of the constants, one row per axis.
P_BAND: Final = 0  # half the play, rad; 0 leaves the axis out
P_PROGRAM: Final = 1  # half the play that is taken care of for the program's own motion, rad
P_WIDTH: Final = 2  # half width of the play operator, rad
P_STEP: Final = 3  # largest change in a cycle, rad
PARAMETERS: Final = 4

# Columns of the memory, one row per axis.
M_BOTH: Final = 0  # play operator of program and correction, rad
M_PROGRAM: Final = 1  # of the program alone
M_VALUE: Final = 2  # what is added now
MEMORY: Final = 3
_ACTIVE, _HOLD, _FAULT = int(State.ACTIVE), int(State.HOLD), int(State.FAULT)


@kernel("void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], int64, int64)")
def compensate_play(parameters: Float, memory: Float, q: Float, added: Float, begin: int, doing: int) -> None:
    """One cycle: what to add to the axis correction, into the last column of the memory.

    Args:
        parameters: (6, PARAMETERS).
        memory: (6, MEMORY); changed.
        q: (6,) rad, commanded without correction.
        added: (6,) rad, correction sent for the deflection.
        begin: 1 in the first cycle.
        doing: 1 acts, 0 goes to zero, -1 stands still.
    """
    for j in range(6):
        p, m = parameters[j], memory[j]
        if p[P_BAND] == 0.0 and p[P_PROGRAM] == 0.0:
            continue
        w, both = p[P_WIDTH], q[j] + added[j]
        if begin == 1:
            m[M_BOTH], m[M_PROGRAM] = both, q[j]
        m[M_BOTH] = min(max(m[M_BOTH], both - w), both + w)
        m[M_PROGRAM] = min(max(m[M_PROGRAM], q[j] - w), q[j] + w)
        wanted = p[P_BAND] * (both - m[M_BOTH]) / w - p[P_PROGRAM] * (q[j] - m[M_PROGRAM]) / w
        if doing == 0:
            wanted = 0.0
        if doing >= 0:
            m[M_VALUE] += min(max(wanted - m[M_VALUE], -p[P_STEP]), p[P_STEP])


@kernel("void(float64[::1], int64[::1], float64[::1], int64[::1], float64[:, ::1], float64[:, ::1], int64[::1])")
def play_after(
    given: Float, flags: Int, results: Float, outcome: Int, parameters: Float, memory: Float, begun: Int
) -> None:
    """After the step of a cycle: add to its axis correction; where an input is no number, what was added stays.

    Args:
        given: (at.GIVEN,) inputs of the cycle.
        flags: (at.FLAGS,) likewise.
        results: (at.RESULTS,) of the step; the axis correction is changed.
        outcome: (at.OUTCOME,) likewise.
        parameters: (6, PARAMETERS); no rows: nothing is compensated.
        memory: (6, MEMORY); changed.
        begun: (1,) 1: not the first cycle; changed.
    """
    if parameters.shape[0] == 0:
        return
    if flags[at.F_ELAPSED] > 0 and all_finite(given, at.G_Q, at.G_Q + 6):
        state = outcome[at.O_STATE]
        doing = 1 if state == _ACTIVE else (-1 if state in (_HOLD, _FAULT) else 0)
        q, axes = given[at.G_Q : at.G_Q + 6], results[at.R_AXES : at.R_AXES + 6]
        compensate_play(parameters, memory, q, axes, 1 - begun[0], doing)
        begun[0] = 1
    still = outcome[at.O_SILENT] != 0
    for k in range(6):
        still = still and results[at.R_CORRECTION + k] == 0.0
    for j in range(6):
        if still:  # nothing is in effect any more, so nothing is held for the next session
            memory[j, M_VALUE] = 0.0
        results[at.R_AXES + j] += memory[j, M_VALUE]
