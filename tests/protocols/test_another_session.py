"""A controller that sends from another port is another session only while the one that is answered is silent."""

from __future__ import annotations

from counterflex.protocols.robot.port import Counters
from counterflex.protocols.session.telegram_watch import AnotherSession
from counterflex.runtime.step.place import FAULT_LOST

HOST = 0x7F000001


def sees(port: int, moved: int, silent: int, sender: int = HOST << 16 | 4000) -> int:
    counters = Counters(sender=sender)
    session = AnotherSession(counters)
    session.heard()
    counters.moved, counters.moved_port = moved, port
    return session.port(silent)


def test_it_is_seen_from_ten_telegrams_on_behind_ten_silent_cycles() -> None:
    assert sees(5000, FAULT_LOST, FAULT_LOST) == 5000
    assert sees(5000, FAULT_LOST - 1, FAULT_LOST) == 0
    assert sees(5000, FAULT_LOST, FAULT_LOST - 1) == 0


def test_nobody_the_same_port_and_telegrams_of_before_are_no_other_session() -> None:
    assert sees(5000, FAULT_LOST, FAULT_LOST, sender=-1) == 0
    assert sees(4000, FAULT_LOST, FAULT_LOST) == 0
    counters = Counters(sender=HOST << 16 | 4000, foreign=100, moved=100, moved_port=5000)
    assert AnotherSession(counters).port(50) == 0
