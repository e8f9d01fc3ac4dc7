"""The parts of the payload recipe are those that will be tried on these readings, by what they cost."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from counterflex.identify.payload.hose_pack import trials_of


def readings(orientations: int) -> Any:
    return [cast(Any, SimpleNamespace(group=np.repeat(np.arange(orientations), 3)))]


@pytest.mark.parametrize(("orientations", "count"), [(12, 1), (30, 4), (150, 7)])
def test_only_what_will_be_tried_is_planned(orientations: int, count: int) -> None:
    trials = trials_of(readings(orientations), (1, 2), ("", "axis3", "axis4"), forced=False)
    assert len(trials) == count


def test_more_functions_cost_more() -> None:
    """As measured with 150 orientations: 0.18 s without, 0.66 s and 5.2 s of processor time with degree 1 and 2."""
    costs = list(trials_of(readings(150), (1, 2), ("",), forced=False).values())
    measured = np.array([0.18, 0.66, 5.2])
    ratio = np.array(costs) / costs[0] / (measured / measured[0])
    assert np.all((ratio > 0.7) & (ratio < 1.4))


def test_what_is_forced_is_tried_with_few_readings_too() -> None:
    assert list(trials_of(readings(3), (2,), ("", "axis3"), forced=True)) == [
        "hose pack from base, degree 2",
        "hose pack from axis3, degree 2",
    ]
    assert sum(trials_of(readings(3), (), (), forced=True).values()) > 0.0
