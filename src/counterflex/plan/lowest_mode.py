"""Lowest mode of an elastic robot in a posture: of its masses and springs, of a tap test, or of what robots weigh.

Shaping of corrections, the feed schedule and the answer of drives need a frequency and a damping ratio. In this order:

1. A chain with a mass behind every drive swings as its masses and springs do (:func:`counterflex.plan.modes.modes`,
   with the loop gains of the drives where they are known).
2. Otherwise a tap test says it.
3. Otherwise masses are assumed (:func:`assumed_masses`).

The assumed damping is that of :mod:`counterflex.plan.lowest_mode`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.plan.elastic_motion import DAMPING_S, matrices
from counterflex.plan.elastic_motion_kernel import AXES
from counterflex.plan.modes import lowest_mode, modes
from counterflex.robot.elasticity.chain import ElasticChain, frames
from counterflex.signals.preview import Mode

# Damping ratio of the robot's modes: given, of a tap test, or assumed with an interval. One assumption for all.
# Chatter, resonance and the model in motion all need the damping of modes that few cells have measured. Where neither
# the user nor a tap test gives it, :data:`ASSUMED_DAMPING` is taken everywhere, and a verdict that changes within
# :data:`DAMPING_INTERVAL` says so.
#
# Source: modal tests on milling robots find 0.02 (drives locked) to 0.1 for modes below 30 Hz. Loops of the drives add
# to that: the lowest mode of the robots of the catalogue has 0.1 to 0.4 with speed loops of 150 to 300 1/s
# (:func:`counterflex.plan.modes.lowest_mode`). It is a judgement, not a measurement.

ASSUMED_DAMPING: Final = 0.1
"""Damping ratio of every mode where none was measured: near the geometric mean of the interval."""
DAMPING_INTERVAL: Final = (0.02, 0.3)
"""Damping ratios that the assumed one stands for, from drives locked to drives that yield."""
GIVEN, TAP_TEST, ASSUMED = "given", "tap test", "assumed"


@dataclass(frozen=True)
class Damping:
    """Damping ratio of the robot's modes and how well it is known.

    Raises:
        InputError: The ratios are not in order, or not between 0 and 1.
    """

    ratio: float  # damping ratio of every mode
    low: float  # least ratio that it stands for; the ratio itself where it was measured or given
    high: float  # largest ratio that it stands for
    origin: str  # GIVEN, TAP_TEST or ASSUMED

    def __post_init__(self) -> None:
        """Check the order."""
        if not 0.0 < self.low <= self.ratio <= self.high < 1.0:
            raise InputError(
                "damping ratios are out of range",
                value=(self.low, self.ratio, self.high),
                limit="0 < low <= ratio <= high < 1",
            )

    @classmethod
    def of(cls, measured: float | None, stated_ratio: float | None = None) -> Damping:
        """The ratio that the user gives, otherwise that of a tap test, otherwise the assumed one.

        Args:
            measured: Of a tap test, or None.
            stated_ratio: By the user, or None.
        """
        for ratio, origin in ((stated_ratio, GIVEN), (measured, TAP_TEST)):
            if ratio is not None:
                return cls(ratio, ratio, ratio, origin)
        return cls(ASSUMED_DAMPING, *DAMPING_INTERVAL, ASSUMED)

    @property
    def text(self) -> str:
        """In a few words."""
        if self.origin != ASSUMED:
            return f"{self.ratio:g} ({self.origin})"
        return f"{self.ratio:g} (assumed, {self.low:g} to {self.high:g})"


LINK_SHARES: Final = (0.39, 0.244, 0.232, 0.073, 0.044, 0.017)
"""Mass behind each drive and before the next, of all that moves: KR 300 R2500 ultra, github
JonasWeigand/Robot_Identification (catalogue file of that robot)."""
ASSUMED_KG_PER_M3: Final = 52.0
"""Moving mass over the cube of the length of the arm, of the same robot (820 kg, 2.5 m); robots of the catalogue whose
mass is in their data sheet lie within a factor of two."""
RIGID_HZ: Final = 30.0
"""Where nothing yields there is no mode, and any will do: it shapes corrections that are zero."""


def can_move(chain: ElasticChain) -> bool:
    """Return whether an elastic chain has a mass behind every drive, before the next: inertia needs no guess then."""
    driven = np.flatnonzero(chain.joint >= 0)
    ends = [*driven[1:], chain.n]
    heavy = all(np.any(chain.mass[a:b] > 0.0) for a, b in zip(driven, ends, strict=True))
    return heavy and bool(np.any(chain.compliance > 0.0))


def mode_of(chain: ElasticChain, q: Float, measured: Mode | None) -> Mode:
    """Lowest mode in a posture.

    Args:
        q: (6,) rad.
        measured: Of a tap test; its frequency counts where the chain cannot be moved, its damping where no loop gains
            are known. None: there was none.
    """
    if not can_move(chain):
        if measured is not None:
            return measured
        if not np.any(chain.compliance > 0.0):
            return Mode(2.0 * math.pi * RIGID_HZ, ASSUMED_DAMPING)
        chain = assumed_masses(chain, q)
    M, stiffness = matrices(chain, q)[:2]
    known = Mode(float(modes(M, stiffness).omega_rad_s[0]), ASSUMED_DAMPING) if measured is None else measured
    return lowest_mode(M, stiffness, damping_of(chain, known), chain.servo or (None,) * AXES)


def damping_of(chain: ElasticChain, mode: Mode) -> float:
    """Beta of the damping D = beta K, s: where nothing is known of drives, a mode's ratio has to stand for them.

    Beside drives the springs damp the mode by no more than :data:`ASSUMED_DAMPING`: :data:`DAMPING_S`, of robots of
    8 Hz, would leave a stiff arm without a mode that rings.
    """
    if chain.servo is None:
        return 2.0 * mode.damping_ratio / mode.omega_rad_s
    return min(DAMPING_S, 2.0 * ASSUMED_DAMPING / mode.omega_rad_s)


def assumed_masses(chain: ElasticChain, q: Float) -> ElasticChain:
    """The chain with masses where an axis has none behind it, by the length of the arm.

    Their centres lie half way to the next drive. Only for modes: such a chain must not sag.

    Args:
        q: (6,) rad, any posture: lengths do not depend on it.
    """
    driven = np.flatnonzero(chain.joint >= 0)
    ends = [*driven[1:].tolist(), chain.flange_segment + 1]
    T = frames(chain, q)
    flange = (T[chain.flange_segment] @ chain.T_segment_flange)[:3, 3]
    places = [*(T[i, :3, 3] for i in driven), flange]
    length = sum(float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(places[1:]))
    mass, com = chain.mass.copy(), chain.com.copy()
    for i, end, share, there in zip(driven.tolist(), ends, LINK_SHARES, places[1:], strict=True):
        if not np.any(chain.mass[i:end] > 0.0):
            mass[i] = share * ASSUMED_KG_PER_M3 * length**3
            com[i] = 0.5 * T[i, :3, :3].T @ (there - T[i, :3, 3])
    return replace(chain, mass=mass, com=com)
