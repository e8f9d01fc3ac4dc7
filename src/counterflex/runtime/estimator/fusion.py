"""Fusion of plan, force, tracker and motor currents: which sources there are, and how much each is trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntFlag

import numpy as np

from counterflex.core.arrays import Float, as_positive
from counterflex.core.records import Record
from counterflex.core.units import DEG, MM, UM


class Source(IntFlag):
    """Source of the estimate of a cycle."""

    NOTHING = 0
    PLAN = 1
    FORCE = 2
    TRACKER = 4
    CURRENTS = 8


def level(sources: int) -> str:
    """The sources in words, best first: ``plan + force + tracker``, or ``nothing``."""
    names = [s.name.lower() for s in Source if s and sources & s and s.name is not None]
    return " + ".join(names) if names else "nothing"


@dataclass(frozen=True)
class FusionTuning:
    """Process noise of the estimator, and its prior."""

    factor: float = 0.25  # standard deviation of the force factors at the start
    model: float = 0.15  # of the share of the deflection that the force does not explain
    offset_m: float = 0.5 * MM
    factor_drift: float = 0.05  # what a factor gains per root second
    model_drift: float = 0.02  # likewise
    offset_drift_m: float = 100.0 * UM  # likewise, m
    turn_rad: float = 0.3 * DEG  # offset of the orientation at the start
    turn_drift_rad: float = 0.02 * DEG  # likewise, per root second
    gate: float = 5.0  # standard deviations beyond which a measurement counts less
    tracker_stale_s: float = 0.5  # age at which a tracker or photogrammetry no longer counts as there
    disbelieved: int = 5  # samples in a row, farther off than the largest jump, after which it does not either
    # lowest mode of the arm, Hz, and its damping ratio, about which it swings when it is accelerated or a load comes;
    # None: of a robot that does not swing
    mode: tuple[float, float] | None = None
    # standard deviation of each axis torque found from motor currents: of what its friction changes by
    torque_nm: tuple[float, float, float, float, float, float] = (60.0, 60.0, 60.0, 20.0, 20.0, 20.0)

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in self.__dataclass_fields__:
            value_or_none = getattr(self, name)
            for value in () if value_or_none is None else np.atleast_1d(value_or_none):
                as_positive(f"online: fusion {name}", float(value))

    def packed(self, period_s: float) -> Float:
        """(9,) for the step: growth of k, a, b per cycle, largest variances, orientation's two, gate."""
        return np.array(
            [
                self.factor_drift**2 * period_s,
                self.model_drift**2 * period_s,
                self.offset_drift_m**2 * period_s,
                self.factor**2,
                self.model**2,
                self.offset_m**2,
                self.turn_drift_rad**2 * period_s,
                self.turn_rad**2,
                self.gate,
            ]
        )

    def swing(self, period_s: float) -> tuple[float, float]:
        """``1 / w^2`` s2 of the mode, and what is left of a swing after a cycle; zeros without a mode."""
        if self.mode is None:
            return 0.0, 0.0
        hz, damping = self.mode
        w = 2.0 * math.pi * hz
        return 1.0 / (w * w), math.exp(-damping * w * period_s)

    def begin(self, fusion: Record) -> None:
        """Write what is known at the start into the state: factors 1, model right, no offset."""
        fusion.estimate[:3] = 1.0
        variances = np.square([self.factor] * 3 + [self.model] * 3 + [self.offset_m] * 3)
        fusion.covariance[:] = np.diag(variances)
        fusion.turn_variance = self.turn_rad**2
