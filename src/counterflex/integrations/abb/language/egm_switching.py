"""Statements of a RAPID program to ABB EGM: settings of the movement, and how long it waits for what."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class EgmSwitching:
    """Settings of EGM in the RAPID program."""

    mode: str  # ``path`` or ``pose``
    device: str  # UDP Unicast Device
    configuration: str  # External Motion Interface Data
    period_ms: int  # SampleRate
    timeout_s: float  # CommTimeout
    armed_s: float = 60.0  # How long the program waits for the loop to be armed until it stops; path correction only
    zero_s: float = 3.0  # How long it waits for the correction to be back at zero; likewise
    # Distance from the last point of the path within which the correction counts as zero; likewise
    zero_mm: float = 0.05
    low_pass_hz: float = 20.0  # LpFilter; guidance only, as what follows
    speed_deviation_deg_s: float = 20.0  # MaxSpeedDeviation
    ramp_in_s: float = 0.1  # RampInTime
    window_mm: float = 0.05  # egm_minmax of x, y, z, both ways
    window_deg: float = 0.05  # Of rx, ry, rz
    standing_s: float = 30.0  # CondTime
    end_mm: float = 1.0  # Distance from the end of the path within which the movement may have ended
    armed_signal: str = ""  # Digital input that says that the loop is armed; empty: a person is asked
    correction_signal: str = ""  # Digital output that is 1 while the correction may act; empty: none

    def __post_init__(self) -> None:
        """Check ranges. Raises InputError: a value that is dangerous or that EGM does not take."""
        if self.mode not in ("path", "pose"):
            raise InputError("mode of EGM", value=self.mode, limit="path or pose")
        if not 0.0 < self.timeout_s <= 0.1:
            raise InputError(
                "CommTimeout of EGM", value=f"{self.timeout_s:g} s", limit="> 0 and <= 0.1 s",
                hint="Without messages the robot continues with the last value received",
            )  # fmt: skip
        for name in ("armed_s", "zero_s", "zero_mm", "window_mm", "window_deg", "standing_s", "end_mm"):
            as_positive(name, getattr(self, name))
        as_positive("speed_deviation_deg_s", self.speed_deviation_deg_s)
