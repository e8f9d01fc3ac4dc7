"""Another session of the controller from another port: a controller that was started again takes any free one."""

from __future__ import annotations

from counterflex.protocols.robot.port import Counters
from counterflex.runtime.step.place import FAULT_LOST

_NOBODY = -1


class AnotherSession:
    """Sees that the controller's computer sends from another port while the session that is answered is silent.

    Args:
        counters: Of the robot's link.
    """

    def __init__(self, counters: Counters) -> None:
        self._counters, self._before = counters, counters.foreign

    def heard(self) -> None:
        """The session that is answered still sends."""
        self._before = self._counters.foreign

    def port(self, silent_cycles: int) -> int:
        """Its port; 0: there is none.

        Args:
            silent_cycles: Cycles without a telegram of the session that is answered.
        """
        counters = self._counters
        if silent_cycles < FAULT_LOST or counters.foreign - self._before < FAULT_LOST:
            return 0
        if _NOBODY in (counters.sender, counters.stranger) or counters.stranger == counters.sender:
            return 0
        return counters.stranger & 0xFFFF if counters.stranger >> 16 == counters.sender >> 16 else 0
