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
from counterflex.core.records import Record, Records, record
from counterflex.runtime.primitives.frames import all_finite
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.supervisor import State

PLAY: Final = record(
    band=float,  # half the play, rad; 0 leaves the axis out
    program=float,  # half the play that is taken care of for the program's own motion, rad
    width=float,  # half width of the play operator, rad
    step=float,  # largest change in a cycle, rad
)
"""Constants of an axis."""
PLAYED: Final = record(
    both=float,  # play operator of program and correction, rad
    program=float,  # of the program alone
    added=float,  # rad, now
)
"""What is remembered of an axis."""
_ACTIVE, _HOLD, _FAULT = int(State.ACTIVE), int(State.HOLD), int(State.FAULT)


@kernel("void(Play[::1], Played[::1], float64[::1], float64[::1], boolean, int64)", Play=PLAY, Played=PLAYED)
def compensate_play(plays: Records, memory: Records, q: Float, added: Float, begin: bool, doing: int) -> None:
    """One cycle: what to add to the axis correction, into the memory.

    Args:
        plays: (6,) PLAY.
        memory: (6,) PLAYED; changed.
        q: (6,) rad, commanded without correction.
        added: (6,) rad, correction sent for the deflection.
        begin: It is the first cycle.
        doing: 1 acts, 0 goes to zero, -1 stands still.
    """
    for j in range(6):
        p, m = plays[j], memory[j]
        if p.band == 0.0 and p.program == 0.0:
            continue
        w, both = p.width, q[j] + added[j]
        if begin:
            m.both, m.program = both, q[j]
        m.both = min(max(m.both, both - w), both + w)
        m.program = min(max(m.program, q[j] - w), q[j] + w)
        requested = p.band * (both - m.both) / w - p.program * (q[j] - m.program) / w
        if doing == 0:
            requested = 0.0
        if doing >= 0:
            m.added += min(max(requested - m.added, -p.step), p.step)


@kernel("void(Given, Result, Play[::1], Played[::1], int64[::1])", Play=PLAY, Played=PLAYED, entry=True, **LOOP_TYPES)
def play_after(given: Record, result: Record, plays: Records, memory: Records, begun: Int) -> None:
    """After the step of a cycle: add to its axis correction; where an input is no number, what was added stays.

    Args:
        given: Inputs of the cycle.
        result: Of the step; the axis correction is changed.
        plays: (6,) PLAY; none: nothing is compensated.
        memory: (6,) PLAYED; changed.
        begun: (1,) 1: not the first cycle; changed.
    """
    if plays.shape[0] == 0:
        return
    if given.elapsed > 0 and all_finite(given.q[:]):
        doing = 1 if result.state == _ACTIVE else (-1 if result.state in (_HOLD, _FAULT) else 0)
        compensate_play(plays, memory, given.q[:], result.axes[:], begun[0] == 0, doing)
        begun[0] = 1
    still = result.silent != 0
    for k in range(6):
        still = still and result.correction[k] == 0.0
    for j in range(6):
        if still:  # nothing is in effect any more, so nothing is held for the next session
            memory[j].added = 0.0
        result.axes[j] += memory[j].added
