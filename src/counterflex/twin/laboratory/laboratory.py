"""The measuring equipment around the simulated cell: where instruments truly stand, and how well they measure.

Like the truth, it is drawn from a seed by named streams, so that one more quantity changes no other.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from counterflex.core.arrays import Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import DEG, MM, UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.twin.truth.truth import Truth

NOMINAL_T_BASE_TRACKER = pose.make(rotation.about_z(np.pi), np.array([4.5, 0.5, 1.2]))
"""Where the tracker is thought to stand, facing the robot."""
NOMINAL_T_TCP_TARGET = pose.make(p=np.array([0.0, 0.0, 50.0 * MM]))
"""Where its target is thought to sit: on the spindle, in the frame of the tool tip."""


@dataclass(frozen=True, eq=False)
class Laboratory:
    """Instruments as they truly are."""

    seed: int  # that drew it
    T_base_tracker: Float  # (4, 4)
    T_tcp_target: Float  # (4, 4) tracker target on the last body, in the undeformed frame of the tool tip
    tracker_m: float = 15.0 * UM  # standard deviation of a measured position, per axis
    tracker_rad: float = 30.0 * URAD  # standard deviation of a measured orientation, per axis
    force_n: float = 1.0  # noise of the force sensor, per axis and sample
    moment_nm: float = 0.1  # noise of its moments
    # which day of measuring this is; each session has noise of its own, the instruments stay as they are
    session: str = ""

    def noise(self, name: str) -> np.random.Generator:
        """A random stream of its own for each named measurement of each session."""
        return self._stream(f"{self.seed}:{name}" + (f":{self.session}" if self.session else ""))

    def standing(self, name: str) -> np.random.Generator:
        """A random stream for what belongs to the equipment itself: the same in every session."""
        return self._stream(f"{self.seed}:{name}")

    @staticmethod
    def _stream(place: str) -> np.random.Generator:
        return np.random.Generator(np.random.PCG64(random.Random(f"counterflex-lab-1:{place}").getrandbits(64)))


def _off(rng: np.random.Generator, T: Float, length_m: float, angle_rad: float) -> Float:
    """A pose moved by chance."""
    out: Float = T @ pose.make(rotation.exp(angle_rad * rng.standard_normal(3)), length_m * rng.standard_normal(3))
    return out


def laboratory(seed: int) -> Laboratory:
    """The equipment of a seed: tracker and target off from where they are thought by 20 mm and 2 deg, 2 mm and 1 deg.

    ``seed``: 0, 1, 2, ...
    """
    rng = np.random.Generator(np.random.PCG64(random.Random(f"counterflex-lab-1:{seed}:setup").getrandbits(64)))
    return Laboratory(
        seed=seed,
        T_base_tracker=_off(rng, NOMINAL_T_BASE_TRACKER, 20.0 * MM, 2.0 * DEG),
        T_tcp_target=_off(rng, NOMINAL_T_TCP_TARGET, 2.0 * MM, 1.0 * DEG),
    )


@dataclass(frozen=True, eq=False)
class Measured:
    """Result of a measurement."""

    channels: Mapping[str, Float]  # (n, k) SI by canonical channel name; orientations as rotation vectors (n, 3)
    sigma: Mapping[str, float | Float]  # standard deviation by channel name, SI, scalar or (k,)
    group: Int  # (n,) rows that belong together
    settings: Mapping[str, Any] = field(default_factory=dict)  # further facts that the laboratory would note down
    # of a measuring frame, as it is thought to stand: ``name``, ``position_m``, ``direction``, ``normal``, ``point_m``
    # of each
    sensors: tuple[Mapping[str, Any], ...] = ()


class Order(NamedTuple):
    """Inputs of every measurement."""

    truth: Truth  # the cell as it is
    laboratory: Laboratory  # the instruments as they are, and their noise
    request: Mapping[str, Float]  # columns of a proposal by name, each (n,), SI, the unit as suffix
    settings: Mapping[str, Any]  # what the proposal says besides
    progress: Progress  # progress callback, fraction 0 to 1

    def columns(self, *names: str) -> Float:
        """Columns of the request side by side, (n, len(names)).

        Raises InputError: one is missing, empty, of another length than the first, or has a value that is not finite.
        """
        missing = [name for name in names if name not in self.request]
        if missing:
            raise InputError("the request lacks a column", value=", ".join(missing), limit=", ".join(names))
        first = as_float(names[0], self.request[names[0]], (None,))
        if len(first) == 0:
            raise InputError("the request has no rows", value=names[0])
        return np.stack([first, *(as_float(name, self.request[name], first.shape) for name in names[1:])], axis=1)

    @property
    def q(self) -> Float:
        """(n, 6) rad, joint angles: columns ``q1_rad`` ... ``q6_rad``."""
        return self.columns(*(f"q{axis}_rad" for axis in range(1, 7)))

    @property
    def force(self) -> Float:
        """(n, 3) N on the tool, base axes: columns ``fx_n fy_n fz_n``."""
        return self.columns("fx_n", "fy_n", "fz_n")


class Measurement:
    """The head of all measurements, as a decorator: what is called with the parts of an order and takes the order.

    Each module of this folder that measures a kind of dataset has one, called ``measure``.
    """

    def __init__(self, take: Callable[[Order], Measured]) -> None:
        self.take = take
        self.__doc__ = take.__doc__

    def __call__(
        self,
        truth: Truth,
        laboratory: Laboratory,
        request: Mapping[str, Float],
        settings: Mapping[str, Any],
        progress: Progress = silent,
    ) -> Measured:
        """Measure; see :class:`Order` for the arguments.

        Raises InputError: a column is missing or a setting is unknown or out of range. Raises SimulationError: the
        simulated cell left its physical range.
        """
        return self.take(Order(truth, laboratory, request, settings, progress))
