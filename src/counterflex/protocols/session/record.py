"""One cycle of a session as a row of the record ring, and now and then the loop's whole state beside it."""

from __future__ import annotations

from counterflex.protocols.force.source import ForceSource
from counterflex.protocols.robot.link import RobotLink
from counterflex.protocols.session.pair import PairSource
from counterflex.runtime import record_ring as record
from counterflex.runtime.loop import Loop
from counterflex.runtime.record_ring import RecordRing


def write_record(
    ring: RecordRing, link: RobotLink, loop: Loop, force: ForceSource | None, received: int, sent: int
) -> None:
    """Write what a cycle was given and what it gave into the ring.

    Args:
        ring: See there.
        link: The robot.
        loop: As the cycle left it.
        force: Force sensor, or None.
        received: When the telegram had come, ns, monotonic.
        sent: When the answer was out.
    """
    row = ring.row()
    row[0], row[1], row[2] = link.counter, received, sent
    row[3] = link.elapsed
    row[4] = 0.0 if force is None else force.good
    row[record.SENSOR : record.SECOND] = 0.0 if force is None else force.w_sensor
    row[record.SECOND : record.GIVEN] = 0.0
    if isinstance(force, PairSource):
        row[record.SECOND : record.SECOND + 6], row[record.GIVEN - 2], row[record.GIVEN - 1] = force.record
    row[record.GIVEN : record.FLAGS] = loop.inputs[0]
    row[record.FLAGS : record.RESULTS] = loop.inputs[1]
    row[record.RESULTS : record.OUTCOME] = loop.answers[0]
    row[record.OUTCOME : record.MONITOR] = loop.answers[1]
    fast, tests, events = loop.monitor.columns
    row[record.FAST : record.SENSOR] = fast
    row[record.MONITOR : record.MONITOR_OUTCOME] = tests
    row[record.MONITOR_OUTCOME : record.CYCLE] = events
    row[record.CYCLE] = loop.cycle
    ring.commit()
    if loop.cycle % loop.state_cycles == 0:
        ring.states.put(loop.cycle, received, loop.memory)
