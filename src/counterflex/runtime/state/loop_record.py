"""All that a loop of one cell is set to, given, remembers and answers, in one block of memory."""

from __future__ import annotations

from typing import Final

from counterflex.core.records import record
from counterflex.runtime.state.chosen import SETTINGS
from counterflex.runtime.state.cycle import CYCLE
from counterflex.runtime.state.doubts import LIMITS, MEMORY, WORK
from counterflex.runtime.state.given import GIVEN
from counterflex.runtime.state.memory import PAST, PAST_ROWS, STATE
from counterflex.runtime.state.result import RESULT

LOOP: Final = record(
    given=GIVEN,
    settings=SETTINGS,
    limits=LIMITS,
    state=STATE,
    ring=(PAST, PAST_ROWS),
    result=RESULT,
    tests=MEMORY,
    cycle=CYCLE,
    work=WORK,
)
"""The loop's record: inputs, settings, memory and results."""
