"""Flags of the inputs of a cycle that are numbers."""

from __future__ import annotations

import math

from counterflex.core.jit import kernel
from counterflex.core.records import Record
from counterflex.runtime.primitives.frames import all_finite
from counterflex.runtime.primitives.loop_types import LOOP_TYPES


@kernel("boolean(Given)", **LOOP_TYPES)
def is_sample(given: Record) -> bool:
    """Return whether a tracker's sample, its age and its deviation are numbers."""
    known = math.isfinite(given.tracker_late) and math.isfinite(given.tracker_sigma)
    return known and all_finite(given.actual[:])


@kernel("boolean(Given)", **LOOP_TYPES)
def is_finite(given: Record) -> bool:
    """Return whether every input that is used is a number; a tracker's sample only where there is a new one."""
    finite = all_finite(given.nominal[:]) and all_finite(given.q[:]) and all_finite(given.wrench[:])
    return finite and all_finite(given.torque[:]) and (given.tracker_new == 0 or is_sample(given))
