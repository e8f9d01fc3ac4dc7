"""Two force sensors in one drain: no row of an earlier drain is taken for a sample of this one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.protocols.session.pair import PairSource


class Played:
    """A sensor that has shown a force of 500 N, and now shows what it is told."""

    def __init__(self) -> None:
        self.w_sensor: Float = np.zeros(6)
        self.samples: Float = np.full((512, 6), 500.0)
        self.good, self.first = 0, 7
        self.saturated = self.frozen = False

    def drain(self) -> int:
        self.samples[: self.good] = 1.0
        return self.good

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("flange", "holder", "saturated", "kept"),
    [(4, 40, False, 4), (0, 40, False, 0), (4, 40, True, 0), (4, 0, False, 4)],
)
def test_samples_are_those_of_this_drain(flange: int, holder: int, saturated: bool, kept: int) -> None:
    first, second, wrench = Played(), Played(), SimpleNamespace(fresh=0)
    source = PairSource(first, second, cast(Any, wrench))
    first.good, second.good, first.saturated = flange, holder, saturated
    assert source.drain() == max(flange, holder) if not saturated else holder
    count = min(source.drain(), len(source.samples))  # as the session takes them
    assert count == kept
    assert np.all(source.samples[:count] == 1.0)
    assert source.first == (7 if kept else -1)
    assert wrench.fresh == (1 if kept else 0) | (2 if holder else 0)
