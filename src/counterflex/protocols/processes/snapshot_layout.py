"""Layout of what a loop shows of each cycle: names, kinds and order of the numbers, and their version.

All numbers take 64 bits. SI, part axes, times of the monotonic clock in ns, as everywhere in the loop.
"""

from __future__ import annotations

import hashlib
from typing import Final

from counterflex.core.records import count_of, record
from counterflex.protocols.processes.control_array import Kept, Tally
from counterflex.runtime.monitoring.events import EVENTS

VERSION: Final = 1
"""Raised with every change of :data:`SNAPSHOT`; a reader takes its own version only."""

SNAPSHOT: Final = record(
    number=int,  # of the snapshot, 1 is the first; below zero while it is written
    nominal=(float, 12),  # commanded pose without correction: rotation by rows, position m, part frame
    q=(float, 6),  # axis angles, rad
    correction=(float, 6),  # sent, m and rotation vector
    in_effect=(float, 6),  # of it, what the robot has made by now
    contained=(float, 6),  # correction that the program contains here
    deflection=(float, 6),  # under the force that the correction is computed from
    deviation=(float, 6),  # that the tracker measures; 0 without a new sample
    measured=(float, 6),  # wrench on the tool, filtered, N and N m
    planned=(float, 6),  # planned there, through the same filter
    force=(float, 3),  # measured, along the feed, across it, along the tool, N
    expected=(float, 3),  # planned, likewise
    factor=(float, 3),  # measured by planned force
    share=float,  # of the path length, 0 .. 1; -1 off the plan, or without one
    speed=float,  # share of the programmed speed that is asked for
    rate=float,  # share of it that the robot moves at
    ratio=float,  # measured by planned force, process monitoring; 0 where it is not known
    cut=float,  # m of cut so far
    rise=float,  # of the ratio since the first cut
    value=(float, EVENTS),  # what process monitoring watches, by event
    limit=(float, EVENTS),  # its limit; 0 while an event cannot be seen
    time_ns=int,  # when the snapshot was written
    received_ns=int,  # when the telegram of the cycle came, or the cycle without one began
    compute_ns=int,  # from then to the answer
    cycle=int,  # the loop's own count
    telegrams=int,  # so far
    elapsed=int,  # cycles of the controller since the telegram before; 0: none came
    state=int,
    cause=int,  # of the state
    soft=int,  # what would hold, or keeps the loop from being armed
    hard=int,  # cause of a fault that is still there
    feed_hold=int,
    stop=int,
    silent=int,
    limits=int,  # bits of the limiter
    sources=int,  # bits of what the estimate rests on
    degraded=int,  # why a source is missing
    doubt=int,  # bits of the plausibility checks
    rejected=int,  # samples of the tracker
    cuts=int,  # 1: the plan cuts here
    events=int,  # bits of the events of process monitoring that are on
    slowed=int,  # why the speed is lowered
    enable=int,  # the robot program wants the correction
    tool=int,  # its number
    robot_ns=int,  # last telegram; as the next two
    force_ns=int,  # last good force; -1: no sensor
    tracker_ns=int,  # last good pose; -1: no tracker
    peer=int,  # the controller: IPv4 address times 65536, plus port; -1: nobody yet
    incident_cause=int,  # first cause of the last hold or fault, until it is acknowledged
    incident_state=int,  # the worst state that it led to
    incident_ns=int,  # when it began
    incident_end_ns=int,  # when it was over; 0: it goes on
    incidents=int,  # so far
    panel=int,  # 0 none, 1 there, 2 lost
    may_arm=int,  # the run was started to correct
    tally=(int, len(Tally)),  # counts of :class:`.control_array.Tally`, in order
    kept=(int, len(Kept)),  # what the recorder says, :class:`.control_array.Kept`
    trouble=int,  # 1: the loop's own program failed
    check=int,  # sum over all numbers before it, see :func:`check_of`
)
"""One cycle."""

NUMBERS: Final = count_of(SNAPSHOT)
SLOTS: Final = 256
"""Cycles that are kept: 1 s at 250 Hz."""
MOST: Final = SLOTS - 32
"""Cycles behind the newest that are read: the oldest may be written over meanwhile."""
HEAD: Final = 16
TEXT: Final = 2048
"""Numbers of 64 bits in front of the snapshots: what they are, and what the run is, as text."""
WORDS: Final = HEAD + TEXT + SLOTS * NUMBERS
MAGIC: Final = int.from_bytes(b"CFSNAPSH", "little")

MAGIC_AT, VERSION_AT, LAYOUT_AT, NUMBERS_AT, SLOTS_AT, TEXT_AT, COUNT_AT, ENDED_AT = range(8)
"""Places in the head. COUNT_AT: snapshots so far."""


def layout_number() -> int:
    """63 bits of the SHA-256 over names, kinds and places: another order shows although the version was forgotten."""
    fields = dict(SNAPSHOT.fields or {})
    text = ";".join(f"{name} {kind.str} {kind.shape} {at}" for name, (kind, at, *_) in fields.items())
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little") >> 1
