"""The plausibility tests of one loop: owns what they remember; run before and after every step."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.runtime import plausibility_kernel as pk
from counterflex.runtime.settings import OnlineSettings
from counterflex.runtime.watch_kernel import after_step, before_step

_SETTLED_S = 0.2


class PlausibilityStage:
    """Tests of one loop; see :mod:`counterflex.runtime.plausibility_kernel` for what each can see.

    Args:
        settings: Of the loop.
        choices: (CHOICES,) of the step.
        state: (STATE,) of the step; read.
        whole: (WHOLE,) likewise.
        ring: (RING_ROWS, RING) likewise.

    Attributes:
        memory: (REMEMBERED,) what the tests remember.
        counts: (COUNTS,) their counters.
    """

    def __init__(self, settings: OnlineSettings, choices: Int, state: Float, whole: Int, ring: Float) -> None:
        self._choices, self._state, self._whole, self._ring = choices, state, whole, ring
        self._limits, self._times = settings.plausibility.packed(settings.period_s)
        self._settled = round((_SETTLED_S + 2.0 * settings.smoothing.delay_s) / settings.period_s)
        self.memory: Float = np.zeros(pk.REMEMBERED)
        self.counts: Int = np.zeros(pk.COUNTS, dtype=np.int64)
        self._work: Float = np.zeros((2, 12))

    def reset(self) -> None:
        """Begin anew: nothing seen, nothing doubted."""
        self.memory[:] = 0.0
        self.counts[:] = 0
        self._work[:] = 0.0

    def before(self, given: Float, flags: Int, results: Float) -> None:
        """Take out what must not be used; see :func:`counterflex.runtime.watch_kernel.before_step`."""
        before_step(
            given,
            flags,
            self._choices,
            self._state,
            self._whole,
            self._ring,
            results,
            self._limits,
            self._times,
            self.memory,
            self.counts,
            self._work,
        )

    def after(self, given: Float, flags: Int, results: Float, outcome: Int) -> None:
        """Find doubts; see :func:`counterflex.runtime.watch_kernel.after_step`."""
        after_step(
            given,
            flags,
            self._choices,
            self._state,
            self._whole,
            self._ring,
            results,
            outcome,
            self._limits,
            self._times,
            self._settled,
            self.memory,
            self.counts,
            self._work,
        )

    def numbers(self) -> tuple[Float | Int, ...]:
        """Every number it is made of, for the loop's hash."""
        return self._limits, self._times, np.array([self._settled])
