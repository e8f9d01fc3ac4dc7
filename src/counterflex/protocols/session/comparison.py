"""Findings of a run about robot, frames and plan: numbers by name, and the lines that tell them.

The numbers are those of the words that the processes of a run share, so that every reader tells the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from counterflex.protocols.processes.control_array import Shown
from counterflex.protocols.session.tracker_off import WordArray
from counterflex.runtime.state.states import Cause

_NUMBERS: Final = (
    ("missing_mm", Shown.MISSING_NM, 1e-6),
    ("missing_most_mm", Shown.MISSING_MOST_NM, 1e-6),
    ("frame_offset_mm", Shown.FRAME_NM, 1e-6),
    ("frame_offset_deg", Shown.FRAME_UDEG, 1e-6),
    ("off_plan_mm", Shown.PLAN_NM, 1e-6),
    ("feed_by_plan", Shown.PLAN_FEED_PPM, 1e-6),
    ("force_by_plan", Shown.PLAN_FORCE_PPM, 1e-6),
    ("force_spikes", Shown.FORCE_SPIKES, 1),
)


def compared(words: WordArray) -> dict[str, float | None]:
    """Numbers by name; None where nothing has been looked at.

    Args:
        words: Shared, see :mod:`counterflex.protocols.processes.control_array`.
    """
    return {name: None if words[place] < 0 else round(words[place] * unit, 4) for name, place, unit in _NUMBERS}


def comparison_lines(numbers: Mapping[str, Any], cause: Cause, degraded: Cause) -> Iterator[str]:
    """Lines for the status: what is wrong now.

    Args:
        numbers: Of :func:`compared`.
        cause: Of the state of the loop.
        degraded: Why the correction is worse than it could be.
    """
    causes = (cause, degraded)
    if cause == Cause.NOT_CLOSED:
        yield (
            "THE LOOP BEFORE DID NOT END BY ITSELF: the program may be in the cut without its correction, and its feed"
            " is held where it is; take the tool out of the cut, then counterflex operator reset"
        )
    if numbers["missing_mm"] or cause == Cause.ANSWER_SHORT:
        yield (
            f"MISSING AT THE ROBOT: {numbers['missing_most_mm'] or 0.0:.2f} mm of the correction; look for a limit or"
            " a filter of the corrections in the controller, and for its mode (absolute, not relative)"
        )
    if cause == Cause.FRAME_OFFSET:
        yield (
            f"FRAMES OFF by {numbers['frame_offset_mm'] or 0.0:.2f} mm and"
            f" {numbers['frame_offset_deg'] or 0.0:.3f} deg: BASE or TOOL of the program is not that of the cell file;"
            " correct one of them, or set frame_offset_mm and frame_offset_deg in [online] where the difference is"
            " known"
        )
    if Cause.OFF_PATH in causes and numbers["off_plan_mm"] is not None:
        yield (
            f"OFF THE PLAN by {numbers['off_plan_mm']:.2f} mm in the cut: look for another depth, another program or"
            " another BASE"
        )
    if Cause.FEED_DIFFERS in causes and numbers["feed_by_plan"] is not None:
        yield (
            f"FEED {100.0 * numbers['feed_by_plan']:.0f} % of the planned one: the planned forces do not come; set the"
            " override to 100 %, or plan for this feed"
        )
    if numbers["force_spikes"]:
        yield f"{numbers['force_spikes']:.0f} SPIKES of the force sensor left out: look for a loose plug or a bad cable"
    force = numbers["force_by_plan"]
    if Cause.FORCE_OFF_PLAN in causes and force is not None:
        yield f"FORCE {100.0 * force:.0f} % of the planned one since the contact: look for another depth or material"


def not_closed_line(log: str) -> str:
    """Return what is said at the start of a run whose predecessor did not end by itself."""
    return (
        f"the loop that answered this robot before did not end by itself (its log: {log}); this one is not armed before"
        " counterflex operator reset, and holds the feed of a program that wants the correction, or cuts; a correction"
        " that still stands at the robot is taken over and ramped out, and where it is not known nothing is answered:"
        " then stop the robot and end its program at the controller"
    )


def frame_line(numbers: Mapping[str, Any]) -> str:
    """The offset of the frames, told once when the loop is armed; empty where it was not looked at."""
    if numbers["frame_offset_mm"] is None:
        return "frames of program and cell file: not compared, the telegrams hold no axis angles, or axis_check is off"
    return (
        f"frames of program and cell file: {numbers['frame_offset_mm']:.3f} mm and"
        f" {numbers['frame_offset_deg']:.4f} deg apart"
    )


def answer_line(numbers: Mapping[str, Any]) -> str:
    """Return what is known of the robot's answer to the correction."""
    missing = numbers["missing_most_mm"]
    if missing is None:
        return "answer of the robot: not looked at, the controller reports no pose that is known to hold the correction"
    seen = f"up to {missing:.2f} mm of the correction missing" if missing else "nothing of the correction missing"
    return f"answer of the robot, by its reported pose: {seen}"


def summary_lines(numbers: Mapping[str, Any]) -> tuple[str, str]:
    """Return what a run has found of frames and robot."""
    return frame_line(numbers), answer_line(numbers)
