"""The operator of a run that goes on for hours: acknowledges what stopped it, and arms it again, by ordinary requests.

What a person at the cell does with ``counterflex operator``, and nothing else: every request can be refused, and no
check is passed over. A robot program that was stopped has been ended and started again by then, in the simulated cell.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, Final

from counterflex.core.errors import FileFormatError, OutputError

_FREE: Final = ("idle", "ready")
MOST_EVENTS: Final = 1000
PATIENCE: Final = 30
"""Requests in a row without an answer: a recorder that stands still for a while is no reason to end."""


def requested_words(state: str, *, feed_hold: bool) -> str:
    """Requests of an operator who wants the run to go on.

    Args:
        state: Of the loop, as ``operator status`` names it.
        feed_hold: The feed is held.

    Returns:
        ``reset`` in a fault, or where a feed hold is left over once the correction has been ramped out; ``arm`` where
        the loop is ready; else nothing: a hold may end by itself, and a loop that is idle is testing.
    """
    if state == "fault" or (feed_hold and state in _FREE):
        return "reset"
    return "arm" if state == "ready" else ""


class SteadyOperator:
    """Looks at the run now and then.

    Args:
        ask: Sends a request and returns its answer, as :func:`counterflex.app.run.operator_requests.request`.

    Attributes:
        events: Requests that took effect, the first :data:`MOST_EVENTS`: time, action, state and cause before.
        counts: How many of each action took effect, and how many of each were refused.
    """

    def __init__(self, ask: Callable[[str], dict[str, Any]]) -> None:
        self._ask = ask
        self._unheard = 0
        self.events: list[dict[str, Any]] = []
        self.counts: Counter[str] = Counter()

    def look(self, seconds: float) -> str:
        """Look once, and ask for what is wanted.

        Args:
            seconds: Since the beginning, for the events.

        Returns:
            The request that took effect, or empty.

        Raises:
            CounterflexError: The run has not answered :data:`PATIENCE` times in a row.
        """
        try:
            status = self._ask("status")
            self._unheard = 0
            action = requested_words(status["state"], feed_hold=status["feed_hold"])
            if not action:
                return ""
            answer = self._ask(action)
        except (OutputError, FileFormatError):
            self.counts["no answer"] += 1
            self._unheard += 1
            if self._unheard >= PATIENCE:
                raise
            return ""
        if not answer["done"]:
            self.counts[f"{action} refused"] += 1
            return ""
        self.counts[action] += 1
        if len(self.events) < MOST_EVENTS:
            self.events.append(
                {"seconds": round(seconds, 2), "action": action, "state": status["state"], "cause": status["cause"]}
            )
        return action
