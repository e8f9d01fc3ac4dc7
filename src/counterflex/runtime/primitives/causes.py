"""Order of the causes of a hold: the first one found stands, except a sensor's that the estimator does without. Pure.

Causes are looked for one after the other, in the session, before the step and in it, and one number carries what was
found. With ``force = "fused"`` the loss of a sensor does not hold while there is another source. It would hide what is
looked for behind it: lost telegrams, a lost log or panel, a program off its path.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.primitives.loop_types import LOOP_TYPES
from counterflex.runtime.state.states import Cause

_FUSED: Final = 4
"""ForceMode."""
_FORCE_STALE, _FORCE_INVALID = int(Cause.FORCE_STALE), int(Cause.FORCE_INVALID)
_FORCE_SATURATED, _FORCE_OFFSET = int(Cause.FORCE_SATURATED), int(Cause.FORCE_OFFSET)
_TRACKER_LOST: Final = int(Cause.TRACKER_LOST)


@kernel("boolean(int64)")
def of_the_force(soft: int) -> bool:
    """Return whether a cause of a hold says that the force sensor must not be used."""
    return soft in (_FORCE_STALE, _FORCE_INVALID, _FORCE_SATURATED, _FORCE_OFFSET)


@kernel("boolean(Settings, int64)", entry=True, **LOOP_TYPES)
def can_yield(settings: Record, soft: int) -> bool:
    """Return whether a cause of a hold is a sensor's, and does not hold while the estimator has another source.

    Args:
        soft: The cause, or 0.
    """
    if settings.force != _FUSED:
        return False
    return of_the_force(soft) or (soft == _TRACKER_LOST and settings.tracker_lost_holds == 0)


@kernel("int64(Settings, int64, int64)", **LOOP_TYPES)
def next_cause(settings: Record, soft: int, cause: int) -> int:
    """Cause of a hold after one more check.

    ``soft``: cause found before, or 0; ``cause``: cause that this check found, or 0.
    """
    if cause != 0 and (soft == 0 or can_yield(settings, soft)):
        return cause
    return soft
