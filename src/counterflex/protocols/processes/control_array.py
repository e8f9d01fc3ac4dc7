"""The array that the processes of a run share: requests in, tallies and what the loop is doing out, who lives.

Whole 64-bit numbers, so that none is ever seen half written. Times are of the monotonic clock, ns, which is the same
for all processes of a computer. 0 of a time or a process number: nobody has said anything yet.
"""

from __future__ import annotations

from enum import IntEnum


class Request(IntEnum):
    """Requests of the operator's side: places of the control array."""

    ARM = 0
    STOP = 1
    RESET = 2
    END = 3


REQUESTS = len(Request)


class Tally(IntEnum):
    """Counts of the loop for its observers: places of the control array after those of :class:`Request`."""

    FOREIGN = 4
    """Telegrams from an address that is not the controller's."""
    MALFORMED = 5
    OUT_OF_LINE = 6
    """Repeated, overtaken, or of another session."""
    DRAINED = 7
    """Passed over because a newer one was there."""
    LOST = 8
    """By the controller's counter."""
    LATE = 9
    """Answers that came too late for the controller, by its own count; -1 where it does not say."""
    CLOCK = 10
    """How often this computer's clock and the controller's counter parted."""
    TRACKER_SET_BACK = 11
    """How often the tracker's clock was set back."""
    TARES = 12
    """Zeros of the force sensor refused in a row."""
    IDLE_MN = 13
    """What the sensor showed then, mN."""
    IDLE_MNM = 14
    """Its moment, mN m."""


class Kept(IntEnum):
    """State of the log by the recorder: places of the control array after those of :class:`Tally`."""

    TAKEN = 15
    """Records taken over from the loop."""
    TROUBLE = 16
    """Why they cannot be written, see :func:`counterflex.files.logs.run_log.trouble_message`; 0: they are."""
    LOST = 17
    """Records that could not be written, or whose file has gone."""


class Life(IntEnum):
    """Signs of life of the processes: places of the control array after those of :class:`Kept`."""

    LOOP_NS = 18
    """When the loop last said that it lives."""
    RECORDER_NS = 19
    RUN_NS = 20
    """The process that started the others."""
    LOOP_PID = 21
    RECORDER_PID = 22
    RUN_PID = 23
    GONE = 24
    """1: the operating system says that one of the other two has died; written by the loop."""
    ENDED = 25
    """1: the loop has ended by itself."""
    MAY_ARM = 26
    """1: the run was started to correct; one that only watches is not armed from outside."""
    CANNOT_HOLD = 27
    """1: the link has no word for a feed hold; a robot that goes on then is told to stop, which is all there is."""


class Shown(IntEnum):
    """Present values of the loop: places of the control array after those of :class:`Life`."""

    STATE = 28
    CAUSE = 29
    """Of the state, else what keeps the loop from being armed."""
    HARD = 30
    """Cause of a fault that is still there."""
    FEED_HOLD = 31
    CORRECTION_NM = 32
    """Size of the correction that is sent."""
    CYCLES = 33
    """Telegrams so far."""
    ROBOT_NS = 34
    """When the last telegram came."""
    FORCE_NS = 35
    """When the last good force came; -1: there is no force sensor."""
    TRACKER_NS = 36
    """When the last good pose came; -1: there is no tracker."""
    PLACE_PPM = 37
    """Place on the plan, of its length in rows; -1: not on it, or there is no plan."""
    FORCE_MN = 38
    """Measured, filtered; -1: there is none."""
    PLANNED_MN = 39
    """Planned there, through the same filter; -1: there is no plan."""
    TRACKER_OFF_NM = 40
    """How far from the controller's pose the tracker sees the tool, while that keeps the loop idle; -1: it does not."""
    TRACKER_LIMIT_NM = 41
    """What that may be."""
    TRACKER_TURN_UDEG = 42
    """The same of the orientation, millionths of a degree; -1 likewise."""
    TRACKER_TURN_LIMIT_UDEG = 43
    MISSING_NM = 44
    """Lasting part of the correction that is missing at the robot, where it is told; 0: none is."""
    MISSING_MOST_NM = 45
    """The largest so far; -1: the robot has not reported its pose, so nobody has looked."""
    FRAME_NM = 46
    """Offset of the frames of the program from those of the cell file, learnt before arming; -1: not looked at."""
    FRAME_UDEG = 47
    """The same of the orientation, millionths of a degree."""
    PLAN_NM = 48
    """Lasting distance of the program from the plan in the cut; -1: not looked at yet."""
    PLAN_FEED_PPM = 49
    """Its speed by the planned one; -1 likewise."""
    PLAN_FORCE_PPM = 50
    """Measured by predicted force; -1 likewise."""
    FORCE_SPIKES = 51
    """Single readings of the force sensor that were left out."""


class Panel(IntEnum):
    """State of the operator panel: places of the control array after those of :class:`Shown`."""

    NS = 52
    """When it last said that it lives; 0: there is none, or it has left."""
    PID = 53
    CLIENTS = 54
    """Pages that are connected to it."""


class Course(IntEnum):
    """Beginning of a run and cause of an early end: places of the control array after those of :class:`Panel`."""

    COMPILED = 55
    """Kernels that its processes have compiled."""
    ANOTHER_PORT = 56
    """Port from which the controller began another session while the correction of the one before was in effect; 0:
    none. The run has ended then."""
    UNANSWERED = 57
    """Telegrams that were not answered because the correction that stands at the robot is not known; 0: it is."""


CONTROL = REQUESTS + len(Tally) + len(Kept) + len(Life) + len(Shown) + len(Panel) + len(Course)
"""Length of the whole array."""
