"""States of the loop and causes of leaving them: names and numbers only, for commands that must be quick, too."""

from __future__ import annotations

from enum import IntEnum


class State(IntEnum):
    """State of the loop."""

    IDLE = 0
    """Answers with zero; nothing is checked yet."""
    READY = 1
    """Telegrams and sensors are there and have passed their tests."""
    ARMED = 2
    """Answers with zero, all monitors live, waits for the robot program."""
    ACTIVE = 3
    """Corrects."""
    HOLD = 4
    """The output stands still, feed hold is requested."""
    RAMP_OUT = 5
    """The output goes slowly to zero."""
    FAULT = 6
    """The output is held, the robot is told to stop; a person must reset."""


class Cause(IntEnum):
    """Cause of leaving a state; the first one of an incident is kept."""

    NONE = 0
    OPERATOR = 1
    PROGRAM = 2
    TELEGRAMS_LATE = 3
    TELEGRAMS_STOPPED = 4
    TELEGRAMS_SCATTERED = 5
    TELEGRAM_MALFORMED = 6
    SESSION_RESTARTED = 7
    FORCE_STALE = 8
    FORCE_INVALID = 9
    FORCE_SATURATED = 10
    TRACKER_LOST = 11
    LIMIT_SOFT = 12
    LIMIT_HARD = 13
    CLAMPED_BY_ROBOT = 14
    NOT_FINITE = 15
    DIVERGENCE = 16
    WRONG_FRAME = 17
    WRONG_JOB = 18
    OFF_PATH = 19
    SINGULAR = 20
    HELD_TOO_LONG = 21
    """The robot went on although a feed hold was asked for."""
    ENABLE_LOST = 22
    """The robot program took the correction away in the cut, or wants it again without having been armed anew."""
    LOG_LOST = 23
    """Records are not written: nobody takes them, or the disk does not."""
    CLOCK = 24
    FOREIGN_PEER = 25
    INTERNAL = 26
    """The loop's own program failed."""
    FORCE_OFFSET = 27
    """The sensor shows a force without a cut: wrong load or zero. In the cut: a step of it that neither plan nor speed
    explains, by its zero or by another cut."""
    PROCESS_MISSING_CUT = 28
    PROCESS_OVERLOAD = 29
    PROCESS_WEAR = 30
    PROCESS_BREAKAGE = 31
    PROCESS_CHATTER = 32
    PROCESS_LOW_CHATTER = 33
    RUN_LOST = 34
    """A process of the run has died or stands still: the one that started the loop, or the recorder."""
    TRACKER_JUMP = 35
    """The tracker shows the tool where it cannot be."""
    TRACKER_FROZEN = 36
    """It repeats its last pose while the tool moves."""
    TRACKER_STAMP = 37
    """Its time stamps cannot be."""
    AXIS_ANGLES = 38
    """Axis angles and pose of the same telegram do not belong together."""
    FRAME_OFFSET = 39
    """They do, but for an offset that is too large: BASE or TOOL of the program is not that of the cell file."""
    FORCE_DIFFERS = 40
    """In a calm cut the force is off the plan otherwise than in such cuts before: deeper stock, another material, or
    the sensor's zero. Told only: the next way in air tells which."""
    FORCE_DISAGREES = 41
    """Two force sensors differ by more than noise, zeros and delays explain, for longer than they may."""
    PANEL_LOST = 42
    """The cell asks for an operator panel, and there is none, or it has died or stands still."""
    ANSWER_SHORT = 43
    """The robot makes less of the correction than it is sent, or more, for longer than it may."""
    FEED_DIFFERS = 44
    """The program runs at another feed than the plan was made for."""
    FORCE_OFF_PLAN = 45
    """The measured force lasts off the predicted one by more than a stated share, from the first contact on."""
    NOT_CLOSED = 46
    """The loop that answered this robot before did not end by itself: its program may go on, without its correction."""
