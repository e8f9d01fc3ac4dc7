"""Runout of the tool from the part of the cutting force that repeats once per turn of the spindle.

Teeth that stand at different radii take chips of different thickness: the force then has a part at the spindle's own
frequency, nearly in proportion to the runout. It is seen only in a fast record from a sensor that is true there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.tooth_force import tooth_forces

LEAST_TURNS: Final = 5.0
"""Turns that a stretch must span."""
SAMPLES_PER_TOOTH: Final = 2.5
"""Samples per tooth passing that a record needs."""
_LARGEST: Final = 5.0  # feeds per tooth; the answer no longer grows beyond


@dataclass(frozen=True)
class TurnForce:
    """What repeats once per turn in a settled piece of a cut.

    Attributes:
        amplitude_n: Length of the complex amplitude of the force across the tool axis.
        feed_tooth_m: Feed per tooth.
    """

    amplitude_n: float
    depth_m: float
    entry_rad: float
    exit_rad: float
    feed_tooth_m: float


@dataclass(frozen=True)
class Runout:
    """Offset of the tool's axis from the spindle's, and its standard deviation from the scatter between pieces, m."""

    value_m: float
    sigma_m: float
    pieces: int


def fast_enough(time_s: Float, spindle_rad_s: float, flutes: int) -> bool:
    """Whether a stretch shows single teeth: :data:`SAMPLES_PER_TOOTH` samples each, over :data:`LEAST_TURNS` turns."""
    if len(time_s) < 2:
        return False
    turns = float(np.ptp(time_s)) * spindle_rad_s / (2.0 * math.pi)
    return turns >= LEAST_TURNS and len(time_s) / turns >= SAMPLES_PER_TOOTH * flutes


def turn_amplitude(force: Float, time_s: Float, spindle_rad_s: float, flutes: int) -> float:
    """Amplitude of what repeats once per turn, N: least squares on the harmonics of a turn up to the tooth passing.

    ``force``: (n, 2) N across the tool axis. ``time_s``: (n,) s.

    Raises:
        InputError: The record is not fast or long enough; see :func:`fast_enough`.
    """
    force = as_float("force", force, (len(time_s), 2))
    if not fast_enough(time_s, as_positive("spindle_rad_s", spindle_rad_s), flutes):
        raise InputError("the record does not show single teeth", value=f"{len(time_s)} samples")
    angle = spindle_rad_s * (time_s - time_s[0])
    waves = [np.ones_like(angle)]
    for order in range(1, flutes + 1):
        waves += [np.cos(order * angle), np.sin(order * angle)]
    coefficients, *_ = np.linalg.lstsq(np.stack(waves, axis=1), force, rcond=None)
    return float(np.linalg.norm(coefficients[1:3]))


def predicted_amplitude(turn: TurnForce, cutter: Cutter, law: ForceLaw, runout_m: float) -> float:
    """The same as the model has it with a runout, N."""
    depth = engagement_of_arc(cutter, turn.depth_m, turn.entry_rad, turn.exit_rad)
    teeth = tooth_forces(replace(cutter, runout_m=runout_m), law, depth, turn.feed_tooth_m, trochoid=False)
    wave = np.exp(-1j * teeth.angle_rad)
    return float(np.linalg.norm(2.0 * np.mean(teeth.wrench_tcp[:, :2] * wave[:, None], axis=0)))


def runout(turns: Sequence[TurnForce], cutter: Cutter, law: ForceLaw) -> Runout | None:
    """Runout that gives every piece its amplitude; median over the pieces.

    Returns:
        The runout, or None for a single flute, no piece, or an amplitude beyond what runout can do.
    """
    amplitudes = []
    if cutter.flutes < 2:
        return None
    for turn in turns:
        largest = min(_LARGEST * turn.feed_tooth_m, 0.5 * cutter.radius_m)

        def excess(e: float, turn: TurnForce = turn) -> float:
            return predicted_amplitude(turn, cutter, law, e) - turn.amplitude_n

        if excess(largest) > 0.0:
            amplitudes.append(float(scipy.optimize.brentq(excess, 0.0, largest, xtol=1e-9)))
    if not amplitudes:
        return None
    values = np.array(amplitudes)
    spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
    return Runout(float(np.median(values)), 1.2533 * spread / math.sqrt(len(values)), len(values))
