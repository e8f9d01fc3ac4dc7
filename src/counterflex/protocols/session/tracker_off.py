"""Distance between tracker and controller about where the tool is: how far, the limit, and what to do.

Before the loop is armed this keeps it from being armed (R19, cause ``wrong frame``). The numbers are those of the last
sample that was used, in the words that the processes of a run share, so that every reader tells the same.
"""

from __future__ import annotations

from typing import Any, Final, Protocol

from counterflex.protocols.processes.control_array import Shown

WHAT_TO_DO: Final = (
    "register the tracker to the part anew, by fiducials at the part (docs/tracker.md),"
    " and check BASE and TOOL of the robot program"
)


class WordArray(Protocol):
    """Words that processes share, by their number: an array, or a view that needs no NumPy."""

    def __getitem__(self, key: int, /) -> Any:
        """One word."""


def tracker_off(words: WordArray) -> dict[str, float] | None:
    """Deviation of the tool by the tracker, while that keeps the loop from being armed.

    Args:
        words: Shared, see :mod:`counterflex.protocols.processes.control_array`.

    Returns:
        ``distance_mm`` and ``turn_deg`` between measured and commanded pose, and what each may be, ``limit_mm`` and
        ``limit_deg``; None where that is not what keeps the loop from being armed.
    """
    if words[Shown.TRACKER_LIMIT_NM] <= 0 or words[Shown.TRACKER_OFF_NM] < 0:  # nobody has said anything yet, or not it
        return None
    return {
        "distance_mm": round(words[Shown.TRACKER_OFF_NM] * 1e-6, 3),
        "limit_mm": round(words[Shown.TRACKER_LIMIT_NM] * 1e-6, 3),
        "turn_deg": round(words[Shown.TRACKER_TURN_UDEG] * 1e-6, 4),
        "limit_deg": round(words[Shown.TRACKER_TURN_LIMIT_UDEG] * 1e-6, 4),
    }


def offset_message(off: dict[str, Any]) -> str:
    """The same in words: what, how much against what, what to do.

    Args:
        off: Of :func:`tracker_off`.
    """
    return (
        f"the tracker sees the tool {off['distance_mm']:.2f} mm (limit {off['limit_mm']:g} mm) and"
        f" {off['turn_deg']:.2f} deg (limit {off['limit_deg']:g} deg) from where the controller has it: {WHAT_TO_DO}"
    )
