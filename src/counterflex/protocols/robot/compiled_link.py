"""A robot's link and a force sensor in compiled code, so that one call makes a cycle from the telegram to the answer.

The call does not know whose they are: it has the address of their code and the place of their arrays.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from counterflex.core.array_table import ArrayTable
from counterflex.core.entry_calls import at_address_of
from counterflex.core.records import Records, record
from counterflex.protocols.robot.port import RobotPort

TELEGRAM: Final = record(
    newest=int,  # counter of the newest telegram before this one, ms; written by the caller
    cycle_ms=int,  # cycle of the controller
    counter=int,  # of this telegram, ms
    elapsed=int,  # cycles since the one before
    late=int,  # the controller's count of late answers; -1 where it does not say
    enable=int,  # 1: the robot program wants the correction
    job=int,  # that the program says it is of; 0: none
    clamped=int,  # 1: the controller limits the correction
)
"""A telegram of a robot, beside poses and angles."""
DRAINED: Final = record(
    good=int,  # good samples
    first=int,  # sequence number of the first of them; -1 where they do not come at 1 kHz
    saturated=int,  # 1: one of them was beyond the range
    frozen=int,  # 1: the readings have not changed for a while
)
"""Result of a drain of a force sensor."""

READ: Final = (
    "boolean(int64, uint8[:, ::1], int64, Telegram[::1], float64[::1], float64[::1], float64[::1], float64[::1])"
)
"""Reads the datagram in the first row: table, rows, length, telegram, then where commanded pose (12,), angles (6,),
reported and measured pose (12,) go. False, and nothing is written: it is not simply the next one of this session."""
ANSWER: Final = "int64(int64, int64, int64, float64[::1], boolean, boolean, boolean, float64, int64)"
"""Answers: table, socket or -1, counter, correction (6,), as axes, stop, feed hold, override, state; bytes sent."""
DRAIN: Final = "void(int64, int64, boolean, Drained[::1])"
"""Drains a force sensor: table, socket, taken before, what was found."""
read_telegram = at_address_of(READ, {"Telegram": TELEGRAM})
answer_telegram = at_address_of(ANSWER, {})
drain_force = at_address_of(DRAIN, {"Drained": DRAINED})


class CompiledLink(NamedTuple):
    """Link of a robot in compiled code."""

    telegram: Records  # (1,) TELEGRAM
    port: RobotPort
    read: int  # address of a kernel of the signature READ
    read_table: ArrayTable
    answer: int  # likewise of ANSWER
    answer_table: ArrayTable
    reports: bool  # there are reported and measured poses
    axes: bool  # axis corrections can be sent


class CompiledForce(NamedTuple):
    """Drain of a force sensor in compiled code."""

    drain: int  # address of a kernel of the signature DRAIN
    table: ArrayTable
    fd: int  # socket
