"""Readings that say something else than their manifest: what a quick fit of weight and zero tells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from counterflex.core.arrays import Float
from counterflex.identify.data import alternative_readings
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import Misfit, check_reading, misfit_of
from counterflex.identify.payload.residuals import COM, MASS, Knowledge, SensorEffects, SensorReadings, parameters
from counterflex.identify.solver.parameters import Parameters
from counterflex.identify.solver.solve import solve
from counterflex.sensing.flange_sensor import FlangeSensor

MASS_SHARE = 0.15
"""Standard deviation of the mass in the cell file, for judging units."""
CHANNEL = "w_sensor"


def _exchanged() -> alternative_readings.AlternativeReading:
    return alternative_readings.AlternativeReading(
        CHANNEL,
        "the columns of forces and moments are exchanged",
        "list the columns of the forces first",
        lambda data: _with(data, lambda v: np.ascontiguousarray(v[:, [3, 4, 5, 0, 1, 2]])),
    )


def _mirrored(axis: int) -> alternative_readings.AlternativeReading:
    """A left-handed sensor frame: one axis counts the other way, and moments follow its hand."""
    factor = np.ones(6)
    factor[axis] = -1.0
    factor[[3 + (axis + 1) % 3, 3 + (axis + 2) % 3]] = -1.0
    name = "xyz"[axis]
    signs = ", ".join(f"{int(s)}" for s in factor)
    return alternative_readings.AlternativeReading(
        CHANNEL,
        f"the axes of the sensor are left-handed (axis {name} counts the other way, moments with it)",
        f"write signs = [{signs}] under [channels.{CHANNEL}], or export from a right-handed frame",
        lambda data: _with(data, lambda v: v * factor),
    )


def _with(data: Dataset, change: Callable[[Float], Float]) -> Dataset:
    old = data.channel(CHANNEL)
    return replace(data, channels={**data.channels, CHANNEL: replace(old, values=change(old.values))})


def check_units(
    data: Dataset, sensor: FlangeSensor, block_of: Callable[[Dataset], SensorReadings], *, as_stated: bool
) -> tuple[str, ...]:
    """Refuse data that fit far better when read another way.

    Tried are the units of forces and moments, every sign, exchanged columns, forces for moments, left-handed axes and
    shifted or reversed rows, each by a fit of zero, weight, centre of gravity and a small mounting rotation.

    ``as_stated``: The finding is a remark, not a refusal. Raises InputError: another reading is far better.
    """
    known = replace(Knowledge(), mass_share=MASS_SHARE, mass_kg=MASS_SHARE * max(sensor.mass_kg, 20.0))
    free = parameters(sensor, known, SensorEffects())
    alternatives = [
        *alternative_readings.unit_mistakes(data, CHANNEL),
        *alternative_readings.sign_mistakes(data, CHANNEL),
        *alternative_readings.swapped_columns(data, CHANNEL),
        _exchanged(),
        *(_mirrored(axis) for axis in range(3)),
        *(alternative_readings.row_mistakes(CHANNEL) if data.kind != "sensor_motion" else ()),
    ]
    score = partial(_misfit, block_of, free, judged=sensor.mass_kg > 1.0)
    return check_reading(data, alternatives, score, as_stated=as_stated)


def _misfit(
    block_of: Callable[[Dataset], SensorReadings], free: Parameters, sample: Dataset, *, judged: bool
) -> Misfit:
    fit = solve(free, [block_of(sample)])
    u = fit.parameters.coordinates(fit.values)
    priors = np.array([u[MASS], float(np.linalg.norm(u[COM])) / np.sqrt(3.0)]) if judged else np.zeros(0)
    return replace(misfit_of(fit), priors=priors)
