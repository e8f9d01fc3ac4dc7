"""Signals of the bridge amplifiers of the instrumented holder while the simulated cell works, sample by sample.

The same holder as :class:`counterflex.twin.plant.strain_holder.InstrumentedHolder`, taken on in time: slip elements and
wander have a memory, the holder warms up, a thermometer on it shows that with an error of its own.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.geometry import pose, wrench
from counterflex.twin.plant import strain_holder
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_changes import hose_of

WARM_K, WARM_S = 3.0, 900.0
"""How much the holder warms up from the begin of a run on, and over which time: a spindle at work."""
THERMOMETER_K: Final = 0.05


class StrainStream:
    """The amplifiers' side.

    ``plant``: In which it is; the next body hangs on it. ``warm_k``: See :data:`WARM_K`.

    Raises:
        InputError: There is no such body, or nothing behind it.
    """

    def __init__(
        self,
        holder: strain_holder.InstrumentedHolder,
        segment: str,
        plant: Plant,
        rng: np.random.Generator,
        step_s: float = strain_holder.SAMPLE_S,
        warm_k: float = WARM_K,
    ) -> None:
        names = [body.name for body in plant.truth.bodies]
        if segment not in names[:-1]:
            raise InputError("no spindle holder can sit there", value=segment, limit=", ".join(names[:-1]))
        self._holder, self._segment, self._plant, self._rng = holder, segment, plant, rng
        self._carried, self._step_s, self._warm_k = names[names.index(segment) + 1], step_s, warm_k
        n = len(holder.zero)
        self._limit: Float = np.array(strain_holder.HYSTERESIS_AT)[:, None]
        self._slip: Float = np.zeros((len(strain_holder.HYSTERESIS_AT), n))
        self._before: Float = np.zeros(n)
        self._wander: Float = np.zeros(n)

    def load(self) -> Float:
        """(6,) N, N m on the holder about its origin in its axes: process, weight, inertia, hose, of this moment."""
        plant = self._plant
        T_holder_base = pose.inverse(plant.body_pose(self._segment))
        w = wrench.carry(T_holder_base @ plant.body_pose(self._carried), plant.section_wrench(self._carried))
        pack = plant.truth.other.hose
        if pack is not None:
            arm, tool = plant.body_pose(pack.arm_body), plant.body_pose(plant.truth.bodies[-1].name)
            place, pull = hose_of(pack).on_tool(arm, tool, plant.truth.gravity_base)
            w = w + wrench.carry(T_holder_base @ pose.make(p=place), pull)
        out: Float = w
        return out

    def sample(self, load: Float, time_s: float) -> tuple[Float, float]:
        """Strain that the amplifiers show and temperature that the thermometer shows.

        ``load``: (6,) N, N m, mean of :meth:`load` since the last sample. Returns (n,) dimensionless, deg C.
        """
        holder, rng = self._holder, self._rng
        still = holder.sensitivity @ load
        self._slip = np.clip(self._slip + still - self._before, -self._limit, self._limit)
        self._before = still
        warmer = self._warm_k * -math.expm1(-time_s / WARM_S)
        self._wander += strain_holder.WANDER * math.sqrt(self._step_s) * rng.standard_normal(len(still))
        noise = strain_holder.NOISE * math.sqrt(strain_holder.SAMPLE_S / self._step_s) * rng.standard_normal(len(still))
        strain = (
            still + strain_holder.HYSTERESIS_SHARE * self._slip.sum(axis=0) + holder.zero + warmer * holder.per_kelvin
        )
        return strain + self._wander + noise, strain_holder.REFERENCE_C + warmer + THERMOMETER_K * float(
            rng.standard_normal()
        )
