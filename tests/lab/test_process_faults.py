"""Processes that are killed or asked to end (R12, R22, R28), in short: the command injects them a hundred times."""

from __future__ import annotations

import pytest

from counterflex_lab.faults import SCENARIOS
from counterflex_lab.faults.scenario import Effort

SHORT = ("killed-loop", "asked-to-end", "forced-collection")


@pytest.mark.parametrize("name", SHORT)
def test_the_requirement_holds(name: str) -> None:
    """The robot waits for every answer: nothing here depends on the speed of the machine."""
    scenario = next(s for s in SCENARIOS if s.name == name)
    outcome = scenario.run(Effort(quick=True))
    assert outcome.passed, outcome.happened
