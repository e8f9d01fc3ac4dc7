"""Speeds at which one broken tooth does not show in the samples of the force sensor; closed form of the sampling.

A tool of z teeth that loses one raises the orders 1 .. z - 1 of the spindle against the tooth passing. With n samples a
second, order k at N turns a second appears at ``|k N - m n|``, m the nearest integer. It is lost where it appears below
the high-passes, or where a harmonic of the tooth passing appears so near that the notches do not part them. At
15 000 rpm, three teeth and 1 kHz all orders meet the tooth passing. The spindle turns slower than commanded by a slip
that is not known before the cut; lines that meet at slip 0 part by n Hz for each 100 % of slip.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from counterflex.core.units import MINUTE
from counterflex.runtime.monitoring.fast_force import LEAST_RATE
from counterflex.runtime.monitoring.spindle_lines import SLOW_HZ, TOOTH_ORDERS, VISIBLE_HZ, folded, is_apart
from counterflex.runtime.monitoring.tooth_pattern import MOST

SLIPS: Final = tuple(0.001 * k for k in range(9))
"""Shares by which a spindle turns slower than commanded: 0 of a synchronous motor, 0.8 % of a loaded asynchronous one.
"""
STEP_RPM: Final = 10.0
"""Spacing of the speeds that are proposed."""
_FARTHEST: Final = 0.25


@dataclass(frozen=True)
class HiddenTooth:
    """Cut in which a broken tooth does not show at some speeds that the spindle may have."""

    speed_rpm: float  # commanded spindle speed
    teeth: int  # of the tool
    sample_s: float  # period of the force sensor
    slips: tuple[float, ...]  # those of SLIPS at which it does not show
    # nearest commanded speed at which it shows at every slip; None where there is none within a quarter
    seen_rpm: float | None

    @property
    def mostly(self) -> bool:
        """It shows at fewer than half of the slips: monitoring counts as not looking at it."""
        return 2 * len(self.slips) > len(SLIPS)

    @property
    def where(self) -> str:
        """``at 15000 rpm with 3 teeth and a force sensor of 1000 Hz``, with the slips if it shows at others."""
        text = f"at {self.speed_rpm:g} rpm with {self.teeth} teeth and a force sensor of {1.0 / self.sample_s:g} Hz"
        if len(self.slips) < len(SLIPS):
            low, high = (f"{100.0 * end:.1f}" for end in (min(self.slips), max(self.slips)))
            text += f" while the spindle turns {low} to {high} % slower than commanded"
        return text

    @property
    def sentence(self) -> str:
        """Say what monitoring cannot see, where, and what would show it."""
        return f"not looked at: one broken tooth {self.where}; it shows with {self.remedy}"

    @property
    def remedy(self) -> str:
        """Speed or sampling rate that shows it."""
        if self.seen_rpm is None:
            return f"a sensor of {SLOW_HZ * LEAST_RATE:g} Hz or more, or another speed"
        return f"{self.seen_rpm:g} rpm"


def is_hidden(turn_per_s: float, teeth: int, sample_s: float) -> bool:
    """Return whether one broken tooth does not show at an actual spindle speed.

    It shows where a harmonic of the tooth passing and :data:`~counterflex.runtime.monitoring.tooth_pattern.MOST` of the
    orders between are visible and apart. A single tooth takes all force with it: it shows wherever force does.

    Args:
        turn_per_s: Actual spindle speed, turns per second.
        teeth: Of the tool, >= 1.
        sample_s: Period of the force sensor.
    """
    if teeth == 1:
        return False
    if sample_s * SLOW_HZ * LEAST_RATE > 1.0:
        return True
    turn = turn_per_s * sample_s
    passing = any(folded(turn * k * teeth) > VISIBLE_HZ * sample_s for k in range(1, TOOTH_ORDERS + 1))
    visible = sum(bool(is_apart(turn, order, teeth, sample_s)) for order in range(1, teeth))
    return not passing or visible < MOST * (teeth - 1)


def hidden_tooth(turn_per_s: float, teeth: int, sample_s: float) -> HiddenTooth | None:
    """Return what does not show in a cut; None where a broken tooth shows at every slip.

    Args:
        turn_per_s: Commanded spindle speed, turns per second, > 0.
        teeth: Of the tool, >= 1.
        sample_s: Period of the force sensor.
    """
    slips = _hidden_slips(turn_per_s, teeth, sample_s)
    if not slips:
        return None
    seen_rpm, rpm = None, turn_per_s * MINUTE
    if sample_s * SLOW_HZ * LEAST_RATE <= 1.0:
        first = round(rpm / STEP_RPM)
        candidates = (
            STEP_RPM * (first + sign * step) for step in range(1, int(_FARTHEST * rpm / STEP_RPM)) for sign in (-1, 1)
        )
        seen_rpm = next((one for one in candidates if not _hidden_slips(one / MINUTE, teeth, sample_s)), None)
    return HiddenTooth(round(rpm, 3), teeth, sample_s, slips, seen_rpm)


def hidden_teeth(cuts: Iterable[tuple[float, int]], sample_s: float) -> list[HiddenTooth]:
    """Return what does not show in any of some cuts, one for each speed and number of teeth.

    Args:
        cuts: Commanded spindle speed, turns per second, and teeth of each; those of unknown speed or teeth (0) are
            left out.
        sample_s: Period of the force sensor.
    """
    known = sorted({(turn_per_s, teeth) for turn_per_s, teeth in cuts if turn_per_s > 0.0 and teeth > 0})
    cuts_hidden = (hidden_tooth(turn_per_s, teeth, sample_s) for turn_per_s, teeth in known)
    return [one for one in cuts_hidden if one is not None]


def _hidden_slips(turn_per_s: float, teeth: int, sample_s: float) -> tuple[float, ...]:
    """Slips at which one broken tooth does not show."""
    return tuple(slip for slip in SLIPS if is_hidden(turn_per_s * (1.0 - slip), teeth, sample_s))
