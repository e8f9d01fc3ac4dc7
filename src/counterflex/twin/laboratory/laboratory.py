"""The measuring equipment around the simulated cell: where instruments truly stand, and how well they measure.

Like the truth, it is drawn from a seed by named streams, so that one more quantity changes no other.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.progress import Progress
from counterflex.core.units import DEG, MM, UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.twin.truth.truth import Truth

NOMINAL_T_BASE_TRACKER = pose.make(rotation.about_z(np.pi), np.array([4.5, 0.5, 1.2]))
"""Where the tracker is thought to stand, facing the robot."""
NOMINAL_T_TCP_TARGET = pose.make(p=np.array([0.0, 0.0, 50.0 * MM]))
"""Where its target is thought to sit: on the spindle, in the frame of the tool tip."""


@dataclass(frozen=True, eq=False)
class Laboratory:
    """Instruments as they truly are.

    Attributes:
        seed: That drew it.
        T_base_tracker: (4, 4).
        T_tcp_target: (4, 4) tracker target on the last body, in the undeformed frame of the tool tip.
        tracker_m: Standard deviation of a measured position, per axis.
        tracker_rad: Standard deviation of a measured orientation, per axis.
        force_n: Noise of the force sensor, per axis and sample.
        moment_nm: Noise of its moments.
        session: Which day of measuring this is; each session has noise of its own, the instruments stay as they are.
    """

    seed: int
    T_base_tracker: Float
    T_tcp_target: Float
    tracker_m: float = 15.0 * UM
    tracker_rad: float = 30.0 * URAD
    force_n: float = 1.0
    moment_nm: float = 0.1
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


def laboratory(seed: int) -> Laboratory:
    """The equipment of a seed: tracker and target off from where they are thought by 20 mm and 2 deg, 2 mm and 1 deg.

    Args:
        seed: 0, 1, 2, ...
    """
    rng = np.random.Generator(np.random.PCG64(random.Random(f"counterflex-lab-1:{seed}:setup").getrandbits(64)))

    def off(T: Float, length: float, angle: float) -> Float:
        move = pose.make(rotation.exp(angle * rng.standard_normal(3)), length * rng.standard_normal(3))
        out: Float = T @ move
        return out

    return Laboratory(
        seed=seed,
        T_base_tracker=off(NOMINAL_T_BASE_TRACKER, 20.0 * MM, 2.0 * DEG),
        T_tcp_target=off(NOMINAL_T_TCP_TARGET, 2.0 * MM, 1.0 * DEG),
    )


@dataclass(frozen=True, eq=False)
class Measured:
    """What a measurement gave.

    Attributes:
        channels: (n, k) SI by canonical channel name; orientations as rotation vectors (n, 3).
        sigma: Standard deviation by channel name, SI, scalar or (k,).
        group: (n,) rows that belong together.
        settings: Further facts that the laboratory would note down.
        sensors: Of a measuring frame, as it is thought to stand: ``name``, ``position_m``, ``direction``, ``normal``,
            ``point_m`` of each.
    """

    channels: Mapping[str, Float]
    sigma: Mapping[str, float | Float]
    group: Int
    settings: Mapping[str, Any] = field(default_factory=dict)
    sensors: tuple[Mapping[str, Any], ...] = ()


Measure = Callable[[Truth, Laboratory, Mapping[str, Float], Mapping[str, Any], Progress], Measured]
"""``measure(truth, laboratory, request, settings, progress)``; ``request`` holds the columns of a proposal, SI."""
