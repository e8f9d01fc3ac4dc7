"""PID of one axis: gains of the controller that makes the correction of an axis come to where it is wanted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from counterflex.core.arrays import Float, as_positive
from counterflex.core.errors import InputError

AXES = 6


@dataclass(frozen=True)
class AxisGains:
    """``C(z) = Kp + Ki T / (1 - 1/z) + Kd (1 - a) / T (1 - 1/z) / (1 - a/z)``, ``a = exp(-T / Tf)``."""

    proportional: float = 0.0  # Kp
    integral_per_s: float = 0.0  # Ki, 1/s
    derivative_s: float = 0.0  # Kd, s
    filter_s: float = 0.0  # tf, time constant of the low-pass of the derivative; 0 leaves it out
    most_rad: float = 1e-3  # largest angle that the controller adds; what would go beyond it is not summed up either

    def __post_init__(self) -> None:
        """Check ranges. Raises InputError: a gain is negative or no number, or the limit is not above 0."""
        for name in ("proportional", "integral_per_s", "derivative_s", "filter_s"):
            as_positive(f"PID of an axis: {name}", getattr(self, name), zero=True)
        as_positive("PID of an axis: most_rad", self.most_rad)

    @property
    def idle(self) -> bool:
        """Return whether it does nothing."""
        return self.proportional == 0.0 and self.integral_per_s == 0.0 and self.derivative_s == 0.0

    def packed(self, period_s: float) -> tuple[float, float, float, float, float]:
        """Kp, ``Ki T``, ``Kd (1 - a) / T``, a, and the limit in rad."""
        decay = math.exp(-period_s / self.filter_s) if self.filter_s > 0.0 else 0.0
        rate = self.derivative_s * (1.0 - decay) / period_s
        return self.proportional, self.integral_per_s * period_s, rate, decay, self.most_rad

    def response(self, frequency_hz: Float, period_s: float) -> NDArray[np.complex128]:
        """C at ``z = exp(2 pi i f T)``, (k,) complex."""
        back = np.exp(-2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) * period_s)
        gain, step, rate, decay, _ = self.packed(period_s)
        out: NDArray[np.complex128] = gain + step / (1.0 - back) + rate * (1.0 - back) / (1.0 - decay * back)
        return out

    def sampled(self, period_s: float) -> tuple[Float, Float, Float, float]:
        """``x' = A x + B e, u = C x + D e``: (2, 2), (2,), (2,) and D; sum first, then the filter of the derivative."""
        gain, step, rate, decay, _ = self.packed(period_s)
        A = np.array([[1.0, 0.0], [0.0, decay]])
        return A, np.array([step, (decay - 1.0) * rate]), np.ones(2), gain + step + rate


def six(gains: tuple[AxisGains, ...]) -> tuple[AxisGains, ...]:
    """The gains, one per axis. Raises InputError: they are not six."""
    if len(gains) != AXES:
        raise InputError("PID per axis: controllers", value=len(gains), limit=f"{AXES}, one for each axis")
    return gains


def require_usable(gains: tuple[AxisGains, ...], output: str, tracker: str, *, axis_play: bool) -> None:
    """Refuse controllers of the axes beside what would work against them or make their margins others.

    Args:
        output: Name of how corrections are sent.
        tracker: Name of what is done with a tracker.
        axis_play: Whether the play of the gears is added to the axis corrections.

    Raises:
        InputError: Not six axes, a Cartesian correction, a tracker, or play that is added.
    """
    six(gains)
    for key, value, limit in (
        ("output", output.lower(), "axes"),
        ("tracker", tracker.lower(), "none"),
        ("axis_play", str(axis_play).lower(), "false"),
    ):
        if value != limit:
            raise InputError(
                "a PID per axis does not go with this",
                where=f"[online] {key}",
                value=value,
                limit=limit,
                hint="Change it, or leave out the table [online.axis_pid]",
            )
