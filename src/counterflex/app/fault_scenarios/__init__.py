"""Every fault that is injected, in the order of the requirements."""

from __future__ import annotations

from typing import Final

from counterflex.app.fault_scenarios import (
    clocks,
    files,
    holds,
    network,
    processes,
    realtime,
    rubbish,
    sessions,
    strangers,
)
from counterflex.app.fault_scenarios.scenario import Scenario

SCENARIOS: Final[tuple[Scenario, ...]] = tuple(
    sorted(
        (
            *network.SCENARIOS,
            *sessions.SCENARIOS,
            *rubbish.SCENARIOS,
            *clocks.SCENARIOS,
            *strangers.SCENARIOS,
            *processes.SCENARIOS,
            *files.SCENARIOS,
            *holds.SCENARIOS,
            *realtime.SCENARIOS,
        ),
        key=lambda scenario: int(scenario.requirement[1:]),
    )
)
