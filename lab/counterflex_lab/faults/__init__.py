"""Every fault that is injected, in the order of the requirements."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from counterflex_lab.faults import (
    clocks,
    disobedience,
    files,
    holds,
    lying_robot,
    lying_sensors,
    malformed,
    network,
    network_early,
    processes,
    realtime,
    run_ends,
    sessions,
    unknown_senders,
)
from counterflex_lab.faults.scenario import SENSORS, Scenario

_FORCE_ONLY: Final = (*processes.SCENARIOS, *files.SCENARIOS, *realtime.SCENARIOS, *run_ends.SCENARIOS)
SCENARIOS: Final[tuple[Scenario, ...]] = tuple(
    sorted(
        (
            *network.SCENARIOS,
            *network_early.SCENARIOS,
            *sessions.SCENARIOS,
            *malformed.SCENARIOS,
            *clocks.SCENARIOS,
            *unknown_senders.SCENARIOS,
            *holds.SCENARIOS,
            *lying_sensors.SCENARIOS,
            *lying_robot.SCENARIOS,
            *disobedience.SCENARIOS,
            *(replace(scenario, sensors=SENSORS[:1]) for scenario in _FORCE_ONLY),
        ),
        key=lambda scenario: int(scenario.requirement[1:]),
    )
)
