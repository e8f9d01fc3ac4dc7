"""Tables ``[monitor]`` and ``[override]`` of a cell file: what of the process is watched, how its speed may change."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from counterflex.core.units import MM, MS, UM
from counterflex.cutting.coefficients import ForceLaw, edge_force
from counterflex.files.schema import Table
from counterflex.runtime.monitoring.events import Event
from counterflex.runtime.monitoring.override_settings import OverrideSettings
from counterflex.runtime.monitoring.settings import MonitorSettings, Reaction, low_chatter_time
from counterflex.runtime.settings import OnlineSettings

Above = Annotated[float, Field(gt=0.0, le=1e6)]
Level = Annotated[float, Field(ge=0.0, le=1e6)]
React = Literal["warn", "feed hold", "stop"]


class MonitorTable(Table):
    """Thresholds and reactions of process monitoring."""

    force_limit_n: Above
    moment_limit_nm: Above | None = None
    missing_cut: React = "warn"
    overload: React = "feed hold"
    wear: React = "warn"
    breakage: React = "feed hold"
    chatter: React = "warn"
    low_chatter: React = "warn"
    margin_n: Above = 40.0
    false_alarms_per_h: Annotated[float, Field(gt=0.0, le=100.0)] = 0.01
    model_sigma: Annotated[float, Field(gt=0.0, le=1.0)] = 0.10
    model_probability: Annotated[float, Field(gt=1e-9, lt=0.5)] = 1e-3
    noise_n: Above = 2.0
    sample_noise_n: Above = 1.0
    sample_ms: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0
    filter_ms: Annotated[float, Field(gt=0.0, le=1000.0)] = 16.0
    timing_ms: Level = 60.0
    place_mm: Level = 0.5
    missing_mm: Above = 2.0
    overload_ms: Above = 8.0
    breakage_ms: Above = 24.0
    chatter_ms: Above = 60.0
    chatter_share: Annotated[float, Field(gt=0.0, le=10.0)] = 0.1
    low_chatter_ms: Above | None = None
    low_chatter_share: Annotated[float, Field(gt=0.0, le=10.0)] = 0.1
    settle_ms: Above = 400.0
    wear_mm: Above = 20.0
    wear_false_alarm_m: Annotated[float, Field(gt=0.0, le=1e7)] = 1000.0
    wear_rise: Annotated[float, Field(gt=0.0, le=10.0)] = 0.1
    wear_probability: Annotated[float, Field(gt=1e-9, lt=0.5)] = 1e-3

    def settings(
        self, online: OnlineSettings, exponent: float, inertia_kg: float = 0.0, ring_s: float = 0.0
    ) -> MonitorSettings:
        """Return what the monitor is told.

        Args:
            online: Settings of the loop that it belongs to.
            exponent: Of the force in the feed per tooth, see :func:`feed_exponent`.
            inertia_kg: Mass behind the force sensor whose inertia it feels.
            ring_s: Over which a swing of the arm dies away to 1/e.

        Raises:
            InputError: Values that contradict each other.
        """
        return MonitorSettings(
            reaction={e: Reaction[getattr(self, e.name.lower()).replace(" ", "_").upper()] for e in Event},
            force_limit_n=self.force_limit_n,
            moment_limit_nm=self.moment_limit_nm,
            margin_n=self.margin_n,
            false_alarms_per_h=self.false_alarms_per_h,
            model_sigma=self.model_sigma,
            model_probability=self.model_probability,
            noise_n=self.noise_n,
            fast_noise_n=self.sample_noise_n,
            filter_s=self.filter_ms * MS,
            timing_s=self.timing_ms * MS,
            place_m=self.place_mm * MM,
            missing_m=self.missing_mm * MM,
            overload_s=self.overload_ms * MS,
            breakage_s=self.breakage_ms * MS,
            chatter_s=self.chatter_ms * MS,
            chatter_share=self.chatter_share,
            low_chatter_s=low_chatter_time(ring_s) if self.low_chatter_ms is None else self.low_chatter_ms * MS,
            low_chatter_share=self.low_chatter_share,
            settle_s=self.settle_ms * MS,
            wear_bin_m=self.wear_mm * MM,
            wear_false_alarm_m=self.wear_false_alarm_m,
            wear_rise=self.wear_rise,
            wear_probability=self.wear_probability,
            inertia_kg=inertia_kg,
            stale_cycles=online.stale_cycles,
            follow_s=online.delays.follow_s,
            exponent=exponent,
            period_s=online.period_s,
            sample_s=self.sample_ms * MS,
        )


class OverrideTable(Table):
    """Change of the speed of the robot program by the loop."""

    tolerance_um: Annotated[float, Field(gt=0.0, le=10_000.0)] = 50.0
    least: Annotated[float, Field(ge=0.05, le=1.0)] = 0.3
    change_per_s: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    delay_ms: Annotated[float, Field(ge=0.0, le=1000.0)] = 50.0

    def settings(self) -> OverrideSettings:
        """In SI."""
        return OverrideSettings(self.tolerance_um * UM, self.least, self.change_per_s, self.delay_ms * MS)


def feed_exponent(law: ForceLaw, chip_m: float) -> float:
    """Exponent p of the tangential force in the feed at a chip thickness, ``d log F / d log h``, by differences.

    Args:
        chip_m: Mean chip thickness of the cut, m.
    """
    step = 1e-3
    low, high = (float(edge_force(law, chip_m * (1.0 + side))[0]) for side in (-step, step))
    return float(np.clip((high - low) / (0.5 * (high + low) * 2.0 * step), 0.0, 1.0))
