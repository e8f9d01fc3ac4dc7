"""Process monitoring and feed override of one loop: owns their records. No socket, clock or file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.records import Record, Records, as_reals, as_words, place_of, records
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.fast_force import take_samples
from counterflex.runtime.monitoring.hidden_tooth import HiddenTooth, hidden_teeth
from counterflex.runtime.monitoring.monitor_kernel import watch
from counterflex.runtime.monitoring.override_kernel import ask_speed
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.records import MEMORY, PLAN_ROW, SETTINGS
from counterflex.runtime.monitoring.settings import MonitorSettings


class Monitor:
    """Watches the process beside the step of a loop.

    The kernel of a cycle runs it around the step, over :attr:`records`; without a loop, call :meth:`after` every cycle.
    :meth:`take` hands over the force sensor's own samples of the cycle. What :meth:`take` makes of them (``fast``)
    counts as given, as the tared force does, and is logged as such.

    Args:
        settings: What is watched.
        override: How the program's speed may be changed; None leaves it alone.
        path: (n,) PLAN the plan as the step has it.
        plan: (n,) PLAN_ROW of :func:`counterflex.runtime.monitoring.plan.monitor_plan`; None without a plan.
        off_path_m: Distance from the plan at which it is not believed.
        radius_m: Largest correction.

    Attributes:
        records: Plan, settings and memory as the kernels take them, see
            :mod:`counterflex.runtime.monitoring.records`.
        fast: FAST, what the fast samples say.
        results: RESULTS.
        outcome: OUTCOME.
        columns: The numbers of fast, results and outcome in order, the same memory, as rows of the log hold them.
        overriding: It may change the speed.
    """

    def __init__(
        self,
        settings: MonitorSettings,
        override: OverrideSettings | None,
        path: Records,
        plan: Records | None,
        off_path_m: float,
        radius_m: float,
    ) -> None:
        self.settings = settings
        self._path = path
        given = settings.record(off_path_m, plan is not None)
        given[0].largest_correction = radius_m
        self.overriding = override is not None
        if override is not None:
            given[0].least_speed = override.least
            given[0].speed_step = override.change_per_s * settings.period_s
        memory = records(MEMORY)
        self.records = records(PLAN_ROW, len(path)) if plan is None else plan, given, memory
        self._memory: Record = memory[0]
        self.fast: Record = self._memory.fast
        self.results: Record = self._memory.results
        self.outcome: Record = self._memory.outcome
        self._speed: Float = memory["results"]["speed"]  # read in every cycle, and an open record takes 1 us
        self.columns = as_reals(memory["fast"]), as_reals(memory["results"]), as_words(memory["outcome"])
        self.reset()

    def reset(self) -> None:
        """Begin anew: nothing learnt, no event, full speed."""
        as_words(self.records[2])[:] = 0
        self._memory.speed = self._memory.rate = self.results.speed = 1.0

    def take(self, samples: Float, count: int, number: int, place: Float) -> None:
        """Samples of the force sensor since the last cycle.

        Args:
            samples: (n, >= 3) force in any fixed axes, N, in time.
            count: Samples that are new; those beyond the rows were not kept.
            number: Sequence number of the first.
            place: (2,) on the plan.
        """
        plan, settings, memory = self.records
        row = plan[max(0, int(place[0]))]
        take_samples(samples, min(count, len(samples)), number, row.turn_per_s, int(row.teeth), settings, memory)

    def after(self, given: Record, result: Record, place: Float) -> None:
        """Look at a cycle; may ask for a feed hold in ``result``.

        Args:
            result: RESULT of the step; ``feed_hold`` may be set.
            place: (2,) on the plan.
        """
        watch(given, result, place, self._path, *self.records)
        ask_speed(result, place, *self.records)

    def hidden_teeth(self) -> list[HiddenTooth]:
        """Return the cuts of the plan in which one broken tooth does not show in the samples of the force sensor."""
        rows = self.records[0]
        rows = rows[rows["highest"] > 0.0]
        turn_per_s, teeth = rows["turn_per_s"].tolist(), rows["teeth"].tolist()
        return hidden_teeth(zip(turn_per_s, map(int, teeth), strict=True), self.settings.sample_s)

    def memory(self) -> dict[str, np.ndarray[Any, Any]]:
        """State that it keeps from one cycle to the next, by name."""
        return {"monitor": self.records[2]}

    @property
    def speed(self) -> float:
        """Share of the programmed speed that is asked for, 0 .. 1."""
        return float(self._speed[0])

    @property
    def events(self) -> tuple[Event, ...]:
        """Events that are on."""
        return tuple(event for event in Event if int(self.outcome.on) >> event & 1)

    def numbers(self) -> Iterator[Float | Int]:
        """Every number it is made of, for the loop's hash: as plain arrays, so that hashes in logs of before stay."""
        plan, settings, _ = self.records
        whole, speed, sampling = (place_of(SETTINGS, name) for name in ("planned", "least_speed", "sample_period"))
        yield as_reals(settings)[:whole]
        yield as_words(settings)[whole:speed]
        yield as_reals(settings)[speed:sampling]
        yield as_reals(plan).reshape(len(plan), -1)
