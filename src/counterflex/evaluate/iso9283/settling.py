"""Pose stabilisation time and pose overshoot (ISO 9283:1998, 7.4 and 7.5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.evaluate.iso9283.standstills import Standstill

BAND_M: Final = 0.1 * MM
_READINGS: Final = 10


@dataclass(frozen=True)
class Settled:
    """One approach.

    An excursion counts where it leaves the band by more than the readings at rest scatter: noise on the way in is none.
    """

    time_s: float  # from the first entry into the limit band until the pose stays in it
    # largest distance from the attained pose after that first entry; 0 where it stays within the band
    overshoot_m: float


def settled(time_s: Float, p: Float, before: Standstill | None, stand: Standstill, band_m: float = BAND_M) -> Settled:
    """Stabilisation of one approach.

    Args:
        time_s: (n,) s, of the log.
        p: (n, 3) m.
        before: The standstill before, or None at the beginning of the log.
        stand: The standstill that the approach leads to; its mean is the attained pose.
        band_m: Radius of the limit band about the attained pose.

    Raises:
        InputError: The approach is not in the log, has too few readings, or the noise of the standstill alone leaves
            the band.

    Source: ISO 9283:1998, 7.4 and 7.5.
    """
    first = 0 if before is None else before.last
    away = np.linalg.norm(p[first : stand.last + 1] - stand.p, axis=1)
    half = away[len(away) - max(1, (stand.last - stand.first + 1) // 2) :]
    if float(half.max()) > band_m:
        raise InputError(
            "the pose does not stay in the limit band",
            value=f"{half.max() / MM:.3g} mm",
            limit=f"{band_m / MM:.3g} mm",
            hint="Widen it: --band-mm",
        )
    begin = int(np.argmax(away))
    inside = np.flatnonzero(away[begin:] <= band_m)
    if away[begin] <= band_m or inside[0] == 0 or stand.first - (first + begin) < _READINGS:
        raise InputError("the approach is not in the log, or has too few readings")
    entry = begin + int(inside[0])
    outside = np.flatnonzero(away[entry:] > band_m + float(half.max()))
    last = entry
    if len(outside):
        excursion = entry + int(outside[-1])
        last = excursion + int(np.argmax(away[excursion:] <= band_m))
    time = time_s[first : stand.last + 1]
    return Settled(float(time[last] - time[entry]), float(away[entry:].max()) if len(outside) else 0.0)
