"""Tools that change while the loop runs: matrix, lever and weight of the next one, a new zero, and armed once more.

The robot program ends the correction before the change, as it does at its end: the loop ramps out, the change takes
place with the correction at zero. Meanwhile what belongs to the next tool of the plan takes the place of what belonged
to the last, the zero of the sensor is taken anew, and once it is accepted the loop arms itself again, as the run was
armed before. The program goes on when it sees the loop armed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from counterflex.core.arrays import Bool, Int
from counterflex.core.errors import InputError
from counterflex.protocols.session.tare import Tare
from counterflex.runtime.state.states import Cause, State

_READY, _ARMED = int(State.READY), int(State.ARMED)
_PROGRAM, _WRONG, _NONE = int(Cause.PROGRAM), int(Cause.FORCE_INVALID), int(Cause.NONE)


class ToolChange:
    """Follows the tools of a plan.

    Args:
        tools: (n,) number of the tool at each row of the plan.
        cutting: (n,) whether the row cuts.
        use: Told the number of the tool that is used from now on.

    Attributes:
        tool: Number of the tool that is used, -1 before the first.
        changes: Changes so far.
        arms: The loop is to arm again, because the program ended the correction for this change.

    Raises:
        InputError: Fewer than two rows, or lengths that differ.
    """

    def __init__(self, tools: Int, cutting: Bool, use: Callable[[int], None]) -> None:
        if len(tools) < 2 or len(tools) != len(cutting):
            raise InputError("tools of a plan", value=f"{len(tools)} and {len(cutting)} rows", limit="as many, >= 2")
        self._tools, self._cutting, self._use = tools, cutting, use
        self._next = next_tools(tools, cutting)
        self.tool, self.changes, self.arms = -1, 0, False
        self._before, self._ended = int(State.IDLE), False

    def watch(self, state: int, cause: int, place: float, tare: Tare) -> int:
        """Follow one cycle, before the sensors are read.

        Args:
            cause: Why it is in it.
            place: Row of the plan, with fraction; below 0 unknown.
            tare: Taken anew at a change.

        Returns:
            Cause of a hold where the plan cuts with another tool than the one that is used, else 0.
        """
        row = min(max(0, int(place)), len(self._tools) - 1)
        if state > _ARMED:
            self._ended = self.arms = False
        elif self._before > _ARMED:
            self._ended = cause == _PROGRAM
        elif state == _ARMED:
            self._ended = self.arms = False
        self._before = state
        if state <= _READY and int(self._next[row]) != self.tool:
            if self.tool >= 0:
                tare.again()
                self.changes += 1
                self.arms = self._ended
            self.tool = int(self._next[row])
            self._use(self.tool)
        if state > _READY and self._cutting[row] and int(self._tools[row]) != self.tool:
            return _WRONG
        return _NONE


def next_tools(tools: Int, cutting: Bool) -> Int:
    """(n,) tool of the next row that cuts, each row itself included; behind the last cut the last that cut.

    Args:
        tools: (n,) number of the tool at each row.
        cutting: (n,).
    """
    rows = np.flatnonzero(cutting)
    if len(rows) == 0:
        return np.full(len(tools), tools[-1], dtype=np.int64)
    following = np.minimum(np.searchsorted(rows, np.arange(len(tools))), len(rows) - 1)
    out: Int = np.asarray(tools, dtype=np.int64)[rows[following]]
    return out
