"""Numbers of instruments' datagrams: one damaged number locks nobody out, and a source that counts anew is believed."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest

from counterflex.core.records import records
from counterflex.integrations.ati.link import telegram as netft
from counterflex.integrations.ati.link.link import NetftLink
from counterflex.protocols.force.stream import SampleStream
from counterflex.protocols.sequence_kernel import FAR, ORDER, RESTART, next_step
from counterflex.protocols.strain.link import StrainLink
from counterflex.protocols.strain.telegram import StrainSample
from counterflex.protocols.tracker.link import TrackerLink
from counterflex.protocols.tracker.telegram import DATAGRAM, MAGIC
from counterflex_lab.composed.wires import VirtualInbox

Taken = Callable[[int], int]


def strain() -> Taken:
    inbox = VirtualInbox()
    link = StrainLink("", 0, 6, range_=2e-3, inbox=inbox)

    def take(number: int) -> int:
        inbox.waiting.append(StrainSample(number, number, 0, 20.0, np.full(6, 1e-6 * (number % 9))).telegram())
        return link.drain()

    return take


def tracker() -> Taken:
    inbox = VirtualInbox()
    link = TrackerLink(inbox=inbox)

    def take(number: int) -> int:
        inbox.waiting.append(DATAGRAM.pack(MAGIC, number, number, 0, 0, 1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0, 0.01))
        return int(link.drain())

    return take


def ati() -> Taken:
    inbox = VirtualInbox()
    link = NetftLink(("127.0.0.1", 49152), netft.Scaling(1e-3, 1e-3, 1000, "Net F/T"), inbox=inbox)

    def take(number: int) -> int:
        inbox.waiting.append(struct.pack(">III6i", number, number, 0, number % 9, *range(5)))
        return link.drain()

    return take


def stream() -> Taken:
    link = SampleStream()

    def take(number: int) -> int:
        link.begin()
        link.take(np.full((1, 6), float(number % 9)), sequence=np.array([number]))
        return link.end()

    return take


@pytest.mark.parametrize("instrument", [strain, tracker, ati, stream])
@pytest.mark.parametrize("damaged", [FAR + 2000, 2**31 - 5, 2**31 + 2000, 2**32 - 1])
def test_a_damaged_number_takes_nothing_away_from_those_behind_it(
    instrument: Callable[[], Taken], damaged: int
) -> None:
    take = instrument()
    assert [take(k) for k in range(1000, 1004)] == [1, 1, 1, 1]
    assert take(damaged) == 0
    assert [take(k) for k in range(1004, 1010)] == [1] * 6


@pytest.mark.parametrize("instrument", [strain, tracker, ati, stream])
@pytest.mark.parametrize("begin", [0, 2**31 + 999])
def test_a_source_that_counts_anew_is_believed_after_some_in_a_row(instrument: Callable[[], Taken], begin: int) -> None:
    """One switched off and on again, and one whose first number was damaged."""
    take = instrument()
    assert take(1000) == 1
    assert sum(take(begin + 2 * k) for k in range(RESTART)) == 1  # every second is lost
    assert take(begin + 2 * RESTART) == 1


def test_steps_far_ahead_are_counted_once_they_are_believed() -> None:
    order = records(ORDER)
    order["newest"] = -1
    assert next_step(order, 2**32 - 2, 2**32 - 1) == 1
    assert next_step(order, 1, 2**32 - 1) == 3
    gap = 5 * FAR
    steps = [next_step(order, 1 + gap + k, 2**32 - 1) for k in range(RESTART)]
    assert steps == [0] * (RESTART - 1) + [gap + RESTART - 1]
    assert order["restarts"][0] == 0
