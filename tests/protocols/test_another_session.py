"""A controller that sends from another port is another session only while the one that is answered is silent."""

from __future__ import annotations

from counterflex.protocols.robot.port import Counters
from counterflex.protocols.session.telegram_watch import AnotherSession
from counterflex.runtime.step.place import FAULT_LOST

HOST, OTHER = 0x7F000001, 0x0A000001


def sees(host: int, port: int, foreign: int, silent: int) -> int:
    counters = Counters(sender=HOST << 16 | 4000)
    session = AnotherSession(counters)
    session.heard()
    counters.foreign, counters.stranger = foreign, host << 16 | port
    return session.port(silent)


def test_it_is_seen_from_ten_telegrams_on_behind_ten_silent_cycles() -> None:
    assert sees(HOST, 5000, FAULT_LOST, FAULT_LOST) == 5000
    assert sees(HOST, 5000, FAULT_LOST - 1, FAULT_LOST) == 0
    assert sees(HOST, 5000, FAULT_LOST, FAULT_LOST - 1) == 0


def test_another_computer_and_strangers_of_before_are_not_the_controller() -> None:
    assert sees(OTHER, 5000, FAULT_LOST, FAULT_LOST) == 0
    assert sees(HOST, 4000, FAULT_LOST, FAULT_LOST) == 0
    counters = Counters(sender=HOST << 16 | 4000, foreign=100, stranger=HOST << 16 | 5000)
    assert AnotherSession(counters).port(50) == 0
    assert AnotherSession(Counters(foreign=100)).port(50) == 0
