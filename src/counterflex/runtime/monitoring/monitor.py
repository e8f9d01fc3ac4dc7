"""Process monitoring and feed override of one loop: owns their arrays, gives them names. No socket, clock or file."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.runtime.monitoring import layout as ml
from counterflex.runtime.monitoring.fast_force import COUNTS, MEMORY, take_samples
from counterflex.runtime.monitoring.monitor_kernel import WORK, watch
from counterflex.runtime.monitoring.override_kernel import (
    K_LEAST,
    K_RADIUS,
    K_STEP,
    OVERRIDE_CONSTANTS,
    OVERRIDE_STATE,
    V_SPEED,
    ask_speed,
)
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.settings import FAST_S, MonitorSettings


class Monitor:
    """Watches the process beside the step of a loop.

    The kernel of a cycle runs it around the step, over :meth:`arrays`; without a loop, call :meth:`after` every cycle.
    :meth:`take` hands over the force sensor's own samples of the cycle. What :meth:`take` makes of them (``fast``)
    counts as given, as the tared force does, and is logged as such.

    Args:
        settings: What is watched.
        override: How the program's speed may be changed; None leaves it alone.
        path: (n, PLAN_COLUMNS) the plan as the step has it.
        plan: (n, P_COLUMNS) of :func:`counterflex.runtime.monitoring.plan.monitor_plan`; None without a plan.
        off_path_m: Distance from the plan at which it is not believed.
        radius_m: Largest correction.

    Attributes:
        fast: (FAST,) what the fast samples say.
        results: (RESULTS,).
        outcome: (OUTCOME,).
        settings: As given.
        overriding: It may change the speed.
    """

    def __init__(
        self,
        settings: MonitorSettings,
        override: OverrideSettings | None,
        path: Float,
        plan: Float | None,
        off_path_m: float,
        radius_m: float,
    ) -> None:
        self.settings = settings
        self._path = path
        self._planned = int(plan is not None)
        self._plan = np.zeros((len(path), ml.P_COLUMNS)) if plan is None else plan
        self._constants = settings.constants(off_path_m)
        self._choices = settings.choices(plan is not None)
        self._speed: Float = np.zeros(OVERRIDE_CONSTANTS)
        self._speed[K_RADIUS] = radius_m
        self.overriding = override is not None
        self._speed[K_LEAST] = 1.0 if override is None else override.least
        self._speed[K_STEP] = 0.0 if override is None else override.change_per_s * settings.period_s
        self.fast: Float = np.zeros(ml.FAST)
        self.results: Float = np.zeros(ml.RESULTS)
        self.outcome: Int = np.zeros(ml.OUTCOME, dtype=np.int64)
        self._state: Float = np.zeros(ml.STATE)
        self._whole: Int = np.zeros(ml.WHOLE, dtype=np.int64)
        self._asked: Float = np.zeros(OVERRIDE_STATE)
        self._work: Float = np.zeros(WORK)
        self._memory: Float = np.zeros(MEMORY)
        self._counts: Int = np.zeros(COUNTS, dtype=np.int64)
        self._sampling: Float = np.array([settings.sample_s, FAST_S])
        self.reset()

    def reset(self) -> None:
        """Begin anew: nothing learnt, no event, full speed."""
        for array in (self.fast, self.results, self._state, self._asked, self._work, self._memory):
            array[:] = 0.0
        for counts in (self.outcome, self._whole, self._counts):
            counts[:] = 0
        self._asked[V_SPEED] = 1.0
        self._state[ml.S_RATE] = 1.0
        self.results[ml.R_SPEED] = 1.0

    def take(self, samples: Float, count: int, number: int, place: Float) -> None:
        """Samples of the force sensor since the last cycle.

        Args:
            samples: (n, >= 3) force in any fixed axes, N, in time.
            count: Samples that are new; those beyond the rows were not kept.
            number: Sequence number of the first.
            place: (2,) on the plan.
        """
        row = self._plan[max(0, int(place[0]))]
        take_samples(
            samples,
            min(count, len(samples)),
            number,
            row[ml.P_TURN] if self._planned else 0.0,
            int(row[ml.P_TEETH]) if self._planned else 0,
            self.settings.sample_s,
            FAST_S,
            self._memory,
            self._counts,
            self.fast,
        )

    def after(self, given: Float, flags: Int, results: Float, outcome: Int, place: Float) -> None:
        """Look at a cycle; may ask for a feed hold in ``outcome``.

        Args:
            given: (at.GIVEN,) of the step.
            flags: (at.FLAGS,).
            results: (at.RESULTS,).
            outcome: (at.OUTCOME,); O_FEED_HOLD may be set.
            place: (2,) on the plan.
        """
        watch(
            given,
            flags,
            results,
            outcome,
            place,
            self._path,
            self._plan,
            self.fast,
            self._constants,
            self._choices,
            self._state,
            self._whole,
            self.results,
            self.outcome,
            self._work,
        )
        ask_speed(
            results,
            outcome,
            self._plan,
            place,
            self._planned,
            self._speed,
            self._asked,
            self.results,
            self.outcome,
        )

    def arrays(self) -> tuple[Float | Int, ...]:
        """Its arrays, as the kernel of a cycle takes them.

        Plan, fast samples, constants, choices, speed's constants; state, counters, results, outcome, work space,
        speed's state; memory and counters of the fast samples, sampling period and length of their memory.
        """
        return (
            self._plan,
            self.fast,
            self._constants,
            self._choices,
            self._speed,
            self._state,
            self._whole,
            self.results,
            self.outcome,
            self._work,
            self._asked,
            self._memory,
            self._counts,
            self._sampling,
        )

    def memory(self) -> dict[str, Float | Int]:
        """What it remembers from one cycle to the next: arrays of its own by name, in fixed order."""
        return {
            "fast": self.fast,
            "results": self.results,
            "outcome": self.outcome,
            "state": self._state,
            "counts": self._whole,
            "speed": self._asked,
            "work": self._work,
            "samples.memory": self._memory,
            "samples.counts": self._counts,
        }

    @property
    def speed(self) -> float:
        """Share of the programmed speed that is asked for, 0 .. 1."""
        return float(self.results[ml.R_SPEED])

    @property
    def events(self) -> tuple[ml.Event, ...]:
        """Events that are on."""
        return tuple(event for event in ml.Event if int(self.outcome[ml.O_ON]) >> event & 1)

    def numbers(self) -> tuple[Float | Int, ...]:
        """Every number it is made of, for the loop's hash."""
        return (self._constants, self._choices, self._speed, self._plan)
