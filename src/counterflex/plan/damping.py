"""Damping ratio of the robot's modes: given, of a tap test, or assumed with an interval. One assumption for all.

Chatter, resonance and the model in motion all need the damping of modes that few cells have measured. Where neither the
user nor a tap test gives it, :data:`ASSUMED_DAMPING` is taken everywhere, and a verdict that changes within
:data:`DAMPING_INTERVAL` says so.

Source: modal tests on milling robots find 0.02 (drives locked) to 0.1 for modes below 30 Hz. Loops of the drives add to
that: the lowest mode of the robots of the catalogue has 0.1 to 0.4 with speed loops of 150 to 300 1/s
(:func:`counterflex.plan.modes.lowest_mode`). It is a judgement, not a measurement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import InputError

ASSUMED_DAMPING: Final = 0.1
"""Damping ratio of every mode where none was measured: near the geometric mean of the interval."""
DAMPING_INTERVAL: Final = (0.02, 0.3)
"""Damping ratios that the assumed one stands for, from drives locked to drives that yield."""
GIVEN, TAP_TEST, ASSUMED = "given", "tap test", "assumed"


@dataclass(frozen=True)
class Damping:
    """Damping ratio of the robot's modes and how well it is known.

    Attributes:
        ratio: Damping ratio of every mode.
        low: Least ratio that it stands for; the ratio itself where it was measured or given.
        high: Largest ratio that it stands for.
        origin: :data:`GIVEN`, :data:`TAP_TEST` or :data:`ASSUMED`.

    Raises:
        InputError: The ratios are not in order, or not between 0 and 1.
    """

    ratio: float
    low: float
    high: float
    origin: str

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
