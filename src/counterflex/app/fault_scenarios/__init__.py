"""Every fault that is injected, in the order of the requirements."""

from __future__ import annotations

from typing import Final

from counterflex.app.fault_scenarios import network
from counterflex.app.fault_scenarios.scenario import Scenario

SCENARIOS: Final[tuple[Scenario, ...]] = tuple(
    sorted(network.SCENARIOS, key=lambda scenario: int(scenario.requirement[1:]))
)
