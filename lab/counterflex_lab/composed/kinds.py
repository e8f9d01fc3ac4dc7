"""Kinds of faults: what can go wrong, how much, and which causes the loop may name for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.runtime.state.states import Cause

_C = Cause
_LINE: Final = (_C.TELEGRAMS_LATE, _C.TELEGRAMS_STOPPED, _C.TELEGRAMS_SCATTERED, _C.CLOCK, _C.SESSION_RESTARTED)
"""A line that is late, or a process that does not run in time."""
_LATER: Final = (*_LINE, _C.FORCE_STALE, _C.TRACKER_LOST, _C.TRACKER_STAMP, _C.RUN_LOST, _C.HELD_TOO_LONG)
_FORCE: Final = (_C.FORCE_OFFSET, _C.FORCE_STALE, _C.FORCE_INVALID, _C.FORCE_SATURATED, _C.LIMIT_SOFT, _C.LIMIT_HARD)
_FALSE_FORCE: Final = (*_FORCE, _C.WRONG_FRAME, _C.DIVERGENCE, _C.FORCE_OFF_PLAN, _C.FORCE_DIFFERS, _C.TRACKER_JUMP)
_TRACKER: Final = (
    _C.TRACKER_LOST,
    _C.TRACKER_JUMP,
    _C.TRACKER_FROZEN,
    _C.TRACKER_STAMP,
    _C.WRONG_FRAME,
    _C.DIVERGENCE,
    _C.LIMIT_SOFT,
    _C.LIMIT_HARD,
)
_ROBOT: Final = (
    _C.ANSWER_SHORT,
    _C.WRONG_FRAME,
    _C.DIVERGENCE,
    _C.TRACKER_JUMP,
    _C.AXIS_ANGLES,
    _C.FRAME_OFFSET,
    _C.CLAMPED_BY_ROBOT,
    _C.HELD_TOO_LONG,
)
_PLAN: Final = (_C.OFF_PATH, _C.FEED_DIFFERS, _C.FORCE_OFF_PLAN, _C.FORCE_OFFSET, _C.WRONG_FRAME, _C.FORCE_DIFFERS)

_BASE: Final = (*_ROBOT, *_PLAN)
_UNREAD: Final = (*_LATER, _C.TELEGRAM_MALFORMED)
_UNREAD_FORCE: Final = (*_UNREAD, *_FALSE_FORCE)
_ENDED: Final = (*_LATER, _C.ENABLE_LOST)
_TEXT: Final = (*_LATER, _C.TELEGRAM_MALFORMED)
_READS: Final = (_C.AXIS_ANGLES,)
"""A telegram of RSI has no check of its own: a digit that became another one still reads, and angles and pose of the
same telegram tell it."""
_MORE: Final = (_C.LIMIT_SOFT,)
"""A tracker on a robot that does not follow asks for more and more; a force asks for the same."""
_FALSE_MESSAGE: Final = (*_ENDED, *_ROBOT, *_PLAN, *_FALSE_FORCE, _C.TELEGRAM_MALFORMED)
"""Bytes of a message of EGM stand for numbers without a check of their own: a damaged one may look like anything."""


@dataclass(frozen=True)
class Kind:
    """A kind of fault.

    Attributes:
        words: What happens; ``size`` is in its unit.
        size: Least and largest size.
        causes: Those that the loop may name for it.
        weight: How often it is drawn.
        needs: Parts of a cell, without which there is no such fault; see :attr:`.story.Story.parts`.
        event: It happens at once and has no duration.
        signed: Its size may be negative.
        before: It is there from the beginning.
        acting: Causes more, for what begins while it acts.
        tracked: Causes more, where there is a tracker.
    """

    words: str
    size: tuple[float, float]
    causes: tuple[Cause, ...]
    weight: float = 1.0
    needs: str = ""
    event: bool = False
    signed: bool = False
    before: bool = False
    acting: tuple[Cause, ...] = ()
    tracked: tuple[Cause, ...] = ()


KINDS: Final = {
    # the line between controller and loop
    "late": Kind("telegrams and answers are late by up to so many s", (1e-3, 40e-3), _LATER),
    "lost": Kind("telegrams and answers are lost, share", (0.01, 1.0), _LATER, 2.0),
    "answers-lost": Kind("answers alone are lost, share", (0.05, 1.0), _LATER),
    "repeated": Kind("datagrams come twice, share", (0.05, 1.0), _LINE),
    "reordered": Kind("telegrams are overtaken by the next, share", (0.02, 1.0), _LATER),
    "damaged": Kind("bytes of telegrams are damaged, share", (0.02, 1.0), _TEXT, 2.0, "rsi", acting=_READS),
    "replayed": Kind("telegrams of so many s ago come again between the others", (0.05, 20.0), _LINE),
    "stranger": Kind("another computer sends telegrams too, so many a cycle", (1.0, 5.0), _LINE),
    "two-senders": Kind("another program answers where the loop does not", (1.0, 1.0), (_C.FOREIGN_PEER,), needs="rsi"),
    # clocks
    "clock-jump": Kind("the computer's clock jumps by s", (1e-3, 0.2), _LATER, event=True, signed=True),
    "clock-drift": Kind("it runs fast or slow by a share", (2e-5, 0.05), _LATER, signed=True),
    "cycle-drift": Kind("the controller's cycle is off by a share", (2e-5, 0.05), _LATER, signed=True),
    # force sensor
    "force-silent": Kind("it says nothing", (1.0, 1.0), _FALSE_FORCE, needs="force"),
    "force-frozen": Kind("its reading stands still", (1.0, 1.0), _FALSE_FORCE, needs="force"),
    "force-stuck": Kind("its reading stands still, with noise", (1.0, 1.0), _FALSE_FORCE, needs="force"),
    "force-offset": Kind("it is off by N", (5.0, 2000.0), _FALSE_FORCE, 2.0, "force", signed=True),
    "force-rail": Kind("an axis is at the end of its counts", (1.0, 1.0), _FALSE_FORCE, needs="force", signed=True),
    "force-spikes": Kind("single readings are off by N", (50.0, 1e5), _FALSE_FORCE, needs="force", signed=True),
    "force-unit": Kind("it shows another unit: times", (1e-3, 1e3), _FALSE_FORCE, needs="force"),
    "force-axes": Kind("two of its axes are exchanged", (1.0, 1.0), _FALSE_FORCE, needs="force"),
    "force-turned": Kind("its frame is turned about z by rad", (0.1, 3.14), _FALSE_FORCE, needs="force"),
    "force-nan": Kind("its status forbids the use of its records", (1.0, 1.0), _FALSE_FORCE, needs="force"),
    # strain-gauge spindle holder
    "strain-silent": Kind("it says nothing", (1.0, 1.0), _FALSE_FORCE, needs="holder"),
    "strain-lost": Kind("its datagrams are lost, share", (0.05, 1.0), _FALSE_FORCE, 2.0, "holder"),
    "strain-damaged": Kind("bytes of its datagrams are damaged, share", (0.02, 1.0), _FALSE_FORCE, 2.0, "holder"),
    "strain-frozen": Kind("so many of its bridges stand still", (0.6, 6.0), _FALSE_FORCE, 2.0, "holder"),
    "strain-broken": Kind("so many of its bridges show nothing", (0.6, 6.0), _FALSE_FORCE, 2.0, "holder"),
    "strain-saturated": Kind("so many are beyond their range", (0.6, 6.0), _FALSE_FORCE, 2.0, "holder"),
    "strain-offset": Kind("its bridges are off by um/m", (0.5, 500.0), _FALSE_FORCE, 2.0, "holder", signed=True),
    "strain-drift": Kind("their zeros drift by um/m in a s", (0.05, 50.0), _FALSE_FORCE, 2.0, "holder", signed=True),
    "strain-unit": Kind("they show another unit: times", (1e-3, 1e3), _FALSE_FORCE, needs="holder"),
    # motor currents
    "currents-missing": Kind("telegrams have no currents, share", (0.05, 1.0), _UNREAD, 3.0, "currents"),
    "currents-frozen": Kind("they stand still", (1.0, 1.0), _FALSE_FORCE, 3.0, "currents"),
    "currents-off": Kind("one of them is off by A", (0.1, 30.0), _FALSE_FORCE, 3.0, "currents", signed=True),
    "currents-unit": Kind("they show another unit: times", (1e-2, 1e2), _FALSE_FORCE, 3.0, "currents"),
    # tracker
    "tracker-silent": Kind("it says nothing", (1.0, 1.0), _TRACKER, needs="tracker"),
    "tracker-frozen": Kind("it sends its last pose again", (1.0, 1.0), _TRACKER, needs="tracker"),
    "tracker-stuck": Kind("the same with noise", (1.0, 1.0), _TRACKER, needs="tracker"),
    "tracker-jump": Kind("it is off by m", (5e-5, 1.0), _TRACKER, 2.0, "tracker", signed=True),
    "tracker-drift": Kind("it drifts by m/s", (1e-5, 1e-2), _TRACKER, needs="tracker", signed=True),
    "tracker-reflector": Kind("it sees another reflector, m away", (0.02, 0.5), _TRACKER, needs="tracker"),
    "tracker-beam": Kind("its beam is broken", (1.0, 1.0), _TRACKER, needs="tracker"),
    "tracker-stamp": Kind("its time stamps jump by s", (1e-3, 100.0), _TRACKER, needs="tracker", signed=True),
    # robot
    "robot-share": Kind("it makes this share of the correction", (0.02, 0.9), _ROBOT, 1.5, tracked=_MORE),
    "robot-clamps": Kind("it makes m of the correction at most", (2e-5, 1e-3), _ROBOT, tracked=_MORE),
    "robot-negates": Kind("it makes the opposite", (1.0, 1.0), _ROBOT, tracked=_MORE),
    "robot-delays": Kind("it makes the correction s later", (8e-3, 0.6), _ROBOT, tracked=_MORE),
    "robot-stays": Kind(
        "it stops obeying: what it makes of the correction stays as it is", (1.0, 1.0), _ROBOT, tracked=_MORE
    ),
    "axis-off": Kind("an axis angle that it reports is off by rad", (1e-4, 0.5), _ROBOT, signed=True),
    "pose-off": Kind("the pose that it reports is off by m", (5e-5, 0.05), _ROBOT, signed=True),
    "base-off": Kind("BASE or TOOL of the program is off by m", (1e-4, 0.02), _BASE, needs="program", before=True),
    "ignores-hold": Kind("it goes on although the feed is to be held", (1.0, 1.0), (_C.HELD_TOO_LONG,), needs="rsi"),
    "enable-flickers": Kind("its Enable is lost, share of telegrams", (0.05, 1.0), (_C.ENABLE_LOST,), needs="program"),
    "other-job": Kind("it says the number of another job", (1.0, 1.0), (_C.WRONG_JOB,), needs="rsi", before=True),
    "feed-differs": Kind("the program runs at so many times its feed", (0.2, 2.5), _PLAN, needs="plan program"),
    "plan-deeper": Kind("the program runs m above its plan", (2e-4, 8e-3), _PLAN, needs="plan program", before=True),
    "harder": Kind("the stock is harder: force times", (0.3, 4.0), (*_FALSE_FORCE, *_PLAN)),
    # disk and processes
    "disk-full": Kind("the disk is full", (1.0, 1.0), (_C.LOG_LOST,)),
    "disk-fills": Kind("the disk has room for so many bytes", (1.0, 2e6), (_C.LOG_LOST,), needs="disk"),
    "log-gone": Kind("the folder of the log is moved away", (1.0, 1.0), (_C.LOG_LOST,), needs="disk"),
    "recorder-stopped": Kind("the recorder stands still", (1.0, 1.0), (_C.LOG_LOST,)),
    "recorder-killed": Kind("the recorder is killed", (1.0, 1.0), (_C.RUN_LOST, _C.LOG_LOST), 0.5, event=True),
    "run-stopped": Kind("the process that started the loop stands still", (1.0, 1.0), (_C.RUN_LOST,)),
    "run-killed": Kind("it is killed", (1.0, 1.0), (_C.RUN_LOST,), 0.5, event=True),
    "panel-gone": Kind("the panel stands still", (1.0, 1.0), (_C.PANEL_LOST,)),
    "loop-stopped": Kind("the loop's process is stopped and continued", (1.0, 1.0), _LATER, 2.0),
    "loop-starved": Kind("it gets the processor late, in this share of its cycles", (0.02, 0.9), _LATER),
    "loop-killed": Kind(
        "it is killed, and started again by a person", (1.0, 1.0), (*_LATER, _C.NOT_CLOSED), 0.5, event=True
    ),
    # people
    "operator-stop": Kind("a person stops", (1.0, 1.0), (_C.OPERATOR,), 1.5, event=True),
    "operator-reset": Kind("a person acknowledges", (1.0, 1.0), (), 1.5, event=True),
    "operator-arm": Kind("a person arms", (1.0, 1.0), (), 1.5, event=True),
    "operator-end": Kind("a person ends the run", (1.0, 1.0), (_C.OPERATOR,), 0.5, event=True),
    # controller
    "controller-restart": Kind("it begins another session, after s", (4e-3, 3.0), _LATER, 2.0, event=True),
    "counter-jump": Kind("its counter jumps by ms", (4.0, 1e6), (*_LATER, _C.FOREIGN_PEER), event=True, signed=True),
    "controller-pauses": Kind("it sends nothing", (1.0, 1.0), _LATER),
    # messages of EGM
    "message-damaged": Kind("bytes of messages are damaged, share", (0.02, 1.0), _FALSE_MESSAGE, 4.0, "egm"),
    "message-short": Kind("messages leave a field out, share", (0.02, 1.0), _FALSE_MESSAGE, 2.0, "egm"),
    "sequence-stuck": Kind("messages have the number of the one before, share", (0.05, 1.0), _LATER, 2.0, "egm"),
    "clock-missing": Kind("messages have no time", (1.0, 1.0), _LATER, needs="egm"),
    "motion-limited": Kind(
        "the controller limits the motion: utilization", (1.01, 3.0), _ROBOT, needs="egm", tracked=_MORE
    ),
    "frame-other": Kind("they have the other frame, base or work object", (1.0, 1.0), _BASE, 1.0, "egm", before=True),
    "force-short": Kind("they have five forces, share", (0.02, 1.0), _UNREAD_FORCE, 4.0, "own-force"),
    "movement-ended": Kind("the controller ends the movement", (1.0, 1.0), _ENDED, 2.0, "egm", event=True),
}
ALWAYS: Final = (_C.PROGRAM, _C.OPERATOR)
"""Causes that need no fault: the program ends, and people stop."""
