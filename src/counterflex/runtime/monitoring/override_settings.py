"""Settings of the feed override."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import UM


@dataclass(frozen=True)
class OverrideSettings:
    """Settings of the speed of the robot program."""

    tolerance_m: float = 50.0 * UM  # remaining error across the feed above which the program is slowed down
    least: float = 0.3  # lowest share of the programmed speed
    change_per_s: float = 2.0  # largest change of that share per second
    delay_s: float = 0.05  # from asking until the robot goes slower

    def __post_init__(self) -> None:
        """Check ranges. Raises InputError: a number is out of range."""
        as_positive("override: tolerance_m", self.tolerance_m)
        as_positive("override: change_per_s", self.change_per_s)
        as_positive("override: delay_s", self.delay_s, zero=True)
        if not 0.05 <= self.least <= 1.0:
            raise InputError("override: the least share of speed is out of range", value=self.least, limit="0.05 .. 1")
