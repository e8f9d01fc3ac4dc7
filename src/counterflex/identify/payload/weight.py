"""Check the axes of a wrench by the plain weight, before any rest that depends on orientation is looked for.

Zero, weight and centre of gravity alone, ``f = b + m gamma + (m rho) x gamma``, ``moment = b' + (m c) x gamma`` with
``gamma`` gravity in sensor axes and rho a small mounting rotation, are linear in b, b', m, m rho, m c. The same fit is
done with the file read otherwise: wrench in base axes, rotation transposed, quaternion in another order, sign reversed.
A rest of functions of the rotation would take any of these as a hose pack.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.geometry import rotation
from counterflex.geometry.rotation import skew
from counterflex.identify.data.alternative_readings import AlternativeReading, quaternion_mistakes, transposed
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.payload.data import CHANNEL, axes_of, distinct
from counterflex.identify.payload.residuals import MASS, OFFSET, TURN, SensorReadings
from counterflex.identify.solver.fit import Fit
from counterflex.sensing.flange_sensor import degree_of, orientation_basis

RATIO: Final = 2.0
"""How many times smaller another reading must make the median residual."""
ALIKE: Final = 1.2
"""Factor within which two readings fit alike."""
CHANCE: Final = 1e-3
SURE: Final = 10.0
"""Standard deviations of the weight found that make it one."""
FEWEST: Final = 4
_ROUNDS = 12
_UNKNOWN = 13
_ROTATIONS = ("R_base_flange", "R_base_tcp")
_BlockOf = Callable[[Dataset], SensorReadings]


@dataclass(frozen=True)
class Plain:
    """Zero and weight fitted to readings."""

    size: float  # median of the rows' residuals over their standard deviations, per root of the number of components
    mass_kg: float  # weight found; below zero it pulls upward
    sigma_kg: float  # its standard deviation, by the residuals
    dof: float  # measured numbers less those found

    @property
    def hangs(self) -> bool:
        """Return whether there is a weight, and it hangs down."""
        return self.mass_kg > SURE * self.sigma_kg


def plain_weight(block: SensorReadings) -> Plain:
    """Fit zero, weight, centre of gravity and a small mounting rotation to readings at rest, robustly."""
    n = len(block.group)
    turn = skew(block.gamma)
    J = np.zeros((n, 6, _UNKNOWN))
    J[:, :, :6] = np.eye(6)
    J[:, :3, 6] = block.gamma
    J[:, :3, 7:10] = -turn
    J[:, 3:, 10:] = -turn
    J, y = J / block.sigma[:, :, None], block.w_sensor / block.sigma
    weight: Float = np.ones(n)
    x: Float = np.zeros(_UNKNOWN)
    sizes: Float = np.zeros(n)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        rows = (J * root[:, :, None]).reshape(-1, _UNKNOWN)
        x = np.asarray(np.linalg.lstsq(rows, (y * root).reshape(-1), rcond=1e-10)[0], dtype=np.float64)
        sizes = np.asarray(np.sqrt(np.mean((y - J @ x) ** 2, axis=1)), dtype=np.float64)
        usual = max(2.0 * float(np.median(sizes)), 1e-12)
        # Least absolutes beyond two medians: a hose that lies otherwise in a few poses must not turn the weight.
        weight = np.minimum(1.0, usual / np.maximum(sizes, 1e-300))
    size = float(np.median(sizes))
    information = np.einsum("n,nij,nik->jk", weight, J, J)
    sigma = max(size, 1.0) * float(np.sqrt(np.linalg.pinv(information, rcond=1e-12)[6, 6]))
    return Plain(size, float(x[6]), sigma, float(max(6 * n - _UNKNOWN, 1)))


def axis_readings(data: Dataset, block_of: _BlockOf) -> tuple[AlternativeReading, ...]:
    """Other readings of the rotations and axes of a file."""
    base = axes_of(data) == "base"
    acts = f'write acts_on = "surroundings" under [channels.{CHANNEL}]'
    stated, other, write = (
        ("base", "sensor", f"leave out axes under [channels.{CHANNEL}]")
        if base
        else ("sensor", "base", f'write axes = "base" under [channels.{CHANNEL}]')
    )
    there = f"'{CHANNEL}' is in {other} axes, not in those of the {stated}"
    wrong = f"'{CHANNEL}' was turned by the transposed rotation"
    export = "export it in sensor axes"
    forth, back = partial(_turned, block_of, back=not base), partial(_turned, block_of, back=base)
    out = [
        AlternativeReading(CHANNEL, there, write, forth),
        AlternativeReading(CHANNEL, wrong, export, back),
        AlternativeReading(
            CHANNEL, f"the sign of '{CHANNEL}' is reversed", acts, lambda d: _with(d, -d.channel(CHANNEL).values)
        ),
        AlternativeReading(
            CHANNEL, f"{there}, and its sign is reversed", f"{write} and {acts}", partial(forth, sign=-1.0)
        ),
        AlternativeReading(
            CHANNEL, f"{wrong}, and its sign is reversed", f"{export} and {acts}", partial(back, sign=-1.0)
        ),
    ]
    for name in _ROTATIONS:
        if data.has(name) and not data.has("q"):
            first = (transposed(name), *quaternion_mistakes(name))
            out += first
            out += [
                AlternativeReading(CHANNEL, f"{r.says}, and {there}", f"{r.remedy}; {write}", _both(r, forth))
                for r in first
            ]
    return tuple(out)


def _turned(block_of: _BlockOf, data: Dataset, *, back: bool, sign: float = 1.0) -> Dataset:
    R = block_of(data).R_base_sensor
    R = np.swapaxes(R, 1, 2) if back else R
    return _with(data, sign * (R[:, None] @ data.channel(CHANNEL).values.reshape(-1, 2, 3, 1)).reshape(-1, 6))


def _with(data: Dataset, w: Float) -> Dataset:
    return replace(data, channels={**data.channels, CHANNEL: replace(data.channel(CHANNEL), values=w)})


def _mistakes(data: Dataset, block_of: _BlockOf, stated: Plain) -> list[tuple[AlternativeReading, Plain]]:
    """Readings that fit better than the stated one, the best first."""
    problems = []
    readings = axis_readings(data, block_of)
    for reading in readings:
        try:
            other = plain_weight(block_of(reading.change(data)))
        except CounterflexError:
            continue
        if other.hangs and _better(stated, other, len(readings)):
            problems.append((reading, other))
    return sorted(problems, key=lambda item: item[1].size)


def _both(first: AlternativeReading, then: Callable[[Dataset], Dataset]) -> Callable[[Dataset], Dataset]:
    return lambda d: then(first.change(d))


def check_axes(data: Dataset, block_of: _BlockOf, *, as_stated: bool) -> tuple[str, ...]:
    """Refuse a wrench whose plain weight says that its axes are others than stated.

    Another reading is named where it makes the residual of the plain weight :data:`RATIO` times smaller (F test), or
    fits as well and finds a weight that hangs down where the stated one finds none or one that pulls upward.

    ``data``: Kind ``sensor_poses``; motions are left alone. ``as_stated``: The user insists: the finding is a remark.
    Raises InputError: another reading is found, or the weight pulls upward in all.
    """
    if data.kind != "sensor_poses":
        return ()
    block = block_of(data)
    if len(block.group) < FEWEST or distinct(block) < FEWEST:
        return ()
    stated = plain_weight(block)
    mistakes = _mistakes(data, block_of, stated)
    if not mistakes and stated.mass_kg < -SURE * stated.sigma_kg and not as_stated:
        raise InputError(
            "the weight found pulls upward",
            where=f"{data.where or data.name}: channels.{CHANNEL}",
            value=f"{stated.mass_kg:.4g} kg",
            limit="> 0",
            hint="Check the sign, the axes and the rotation; or add --set as_stated=true",
        )
    if not mistakes:
        return ()
    reading, other = mistakes[0]
    alike = "; ".join(r.says for r, one in mistakes[1:] if one.size <= ALIKE * max(other.size, 1.0))
    text = (
        f"the data suggest that {reading.says}: as stated, the plain weight is {stated.mass_kg:.3g} kg and leaves "
        f"{stated.size:.3g} sigma in median, so read {other.mass_kg:.3g} kg and {other.size:.3g} sigma"
    )
    if alike:
        text += f"; as good: {alike}"
    if as_stated:
        return (f"{data.name}: {text}; used as stated, as requested",)
    raise InputError(
        text,
        where=f"{data.where or data.name}: channels.{reading.channel}",
        hint=f"If so, {reading.remedy}. If the data are right, add --set as_stated=true",
        reading=reading.says,
    )


def _better(stated: Plain, other: Plain, count: int) -> bool:
    ratio = stated.size / max(other.size, 1.0)
    if ratio >= RATIO:
        return count * float(scipy.stats.f.sf(ratio**2, stated.dof, other.dof)) <= CHANCE
    upward = stated.mass_kg < -SURE * stated.sigma_kg
    none = abs(stated.mass_kg) < 0.2 * other.mass_kg
    return (upward or none) and other.size <= ALIKE * max(stated.size, 1.0)


def check_rest(blocks: Sequence[SensorReadings], fit: Fit, *, as_stated: bool) -> tuple[str, ...]:
    """Refuse an orientation-dependent rest as large as the weight: something else than a hose pack is in the data.

    ``as_stated``: The user insists: the finding is a remark. Raises InputError: the force of the rest varies by as much
    as the weight.
    """
    degree = degree_of((len(fit.values) - OFFSET) // 6)
    if not degree:
        return ()
    turn, rest = rotation.exp(fit.values[TURN]), fit.values[OFFSET:].reshape(-1, 6)
    forces = np.concatenate([orientation_basis(b.R_rest @ turn, degree) @ rest[:, :3] for b in blocks])
    largest = float(np.max(np.linalg.norm(forces - forces.mean(axis=0), axis=1)))
    gravity = float(np.median(np.linalg.norm(np.concatenate([b.gamma for b in blocks]), axis=1)))
    weight = float(fit.values[MASS]) * gravity
    if largest < weight:
        return ()
    text = f"the hose terms reach {largest:.3g} N with a weight of {weight:.3g} N ({fit.values[MASS]:.3g} kg)"
    if as_stated:
        return (f"{text}; used, as requested",)
    raise InputError(
        text,
        where=", ".join(b.name for b in blocks),
        limit="hose terms smaller than the weight",
        hint="A hose pack pulls less. Check the axes of the wrench, signs and rotations; --set hose=none fits no "
        "hose terms, --set as_stated=true accepts them",
    )
