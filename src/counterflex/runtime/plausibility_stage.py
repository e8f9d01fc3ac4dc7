"""The plausibility tests of one loop: owns what they remember; the kernel of a cycle runs them around the step."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.runtime.loop_constants import TORQUE_MEMORY_S
from counterflex.runtime.plausibility import kernel as pk
from counterflex.runtime.settings import ForceMode, OnlineSettings, TrackerMode

_SETTLED_S = 0.2


class PlausibilityStage:
    """Tests of one loop; see :mod:`counterflex.runtime.plausibility.kernel` for what each can see.

    Args:
        settings: Of the loop.

    Attributes:
        memory: (REMEMBERED,) what the tests remember.
        counts: (COUNTS,) their counters.
    """

    def __init__(self, settings: OnlineSettings) -> None:
        integrates = settings.tracker in (TrackerMode.INTEGRATOR, TrackerMode.DESIGNED)
        gain = settings.tuning.gain if integrates else 0.0
        fusion, period_s = settings.fusion, settings.period_s
        self._limits, self._times = settings.plausibility.packed(period_s, gain, fusion.mode_hz, fusion.mode_damping)
        self._limits[pk.L_STEP_TORQUE] = period_s / TORQUE_MEMORY_S
        self._limits[pk.L_LATE] = settings.delays.tracker_s
        if settings.force == ForceMode.FUSED:  # which takes slow trackers, too
            self._times[pk.T_SILENT] = max(1, round(settings.fusion.tracker_stale_s / settings.period_s))
        settled = round((_SETTLED_S + 2.0 * settings.smoothing.delay_s) / settings.period_s)
        self._settled: Int = np.array([settled], dtype=np.int64)
        self.memory: Float = np.zeros(pk.REMEMBERED)
        self.counts: Int = np.zeros(pk.COUNTS, dtype=np.int64)
        self._work: Float = np.zeros((2, 14))

    def reset(self) -> None:
        """Begin anew: nothing seen, nothing doubted."""
        self.memory[:] = 0.0
        self.counts[:] = 0
        self._work[:] = 0.0

    def arrays(self) -> tuple[Float | Int, ...]:
        """Limits, times, memory, counters, work space and settling time, as the kernel of a cycle takes them."""
        return self._limits, self._times, self.memory, self.counts, self._work, self._settled

    def numbers(self) -> tuple[Float | Int, ...]:
        """Every number it is made of, for the loop's hash."""
        return self._limits, self._times, self._settled
