"""Unit of a scan: its extent against that of the blank."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.evaluate.inspection.cloud import crowded

LEAST: Final = 0.55
MOST: Final = 1.4
"""A scan of a part is this much of the diagonal of its blank: parts of it may be missing, a little beside it caught."""
WIDEST: Final = 12.0
"""A scan of a part on a table: beyond this the part is too few of its points to be found."""


def diagonal(sample: Float, where: str) -> float:
    """Diagonal of the box about a cloud of points, along its principal axes; outliers left out.

    Args:
        sample: (n, 3) in any unit.
        where: For the error.

    Raises:
        InputError: All points are in one place.
    """
    points = sample[crowded(sample, 0.0)]
    centred = points - np.median(points, axis=0)
    axes = np.linalg.svd(centred[:: max(1, len(centred) // 20_000)], full_matrices=False)[2]
    size = np.ptp(np.percentile(centred @ axes.T, [0.2, 99.8], axis=0), axis=0)
    out = float(np.linalg.norm(size))
    if not out > 0.0:
        raise InputError("all points of the scan are in one place", where=where)
    return out


@dataclass(frozen=True)
class ScanUnit:
    """Units that a scan may be in."""

    # names with SI values: one where the extent of the scan is that of the blank; where the scan is larger in all
    # units, those in which much may have been scanned beside the part
    choices: tuple[tuple[str, float], ...]
    fault: InputError | None = None  # raised where the part lies in the scan in none of them; None: its extent fits


def scan_unit(sample: Float, blank_m: float, units_m: Mapping[str, float], stated: str | None, where: str) -> ScanUnit:
    """Units that a scan may be in.

    Args:
        sample: (n, 3) points in file units.
        blank_m: Diagonal of the blank, m.
        units_m: SI values of the units to choose from, by name.
        stated: Name of the unit that was asked for or that the file states, or None.
        where: For the error.

    Raises:
        InputError: The extent of the scan does not fit the blank in the stated unit, or in none.
    """
    size = diagonal(sample, where)
    ratio = {name: size * unit / blank_m for name, unit in units_m.items()}
    fits = [name for name in units_m if LEAST <= ratio[name] <= MOST]
    if stated is None and len(fits) == 1:
        return ScanUnit(((fits[0], units_m[fits[0]]),))
    if stated is not None and LEAST <= ratio[stated] <= MOST:
        return ScanUnit(((stated, units_m[stated]),))
    fault = _other_size(size, blank_m, units_m, stated, fits, where)
    wide = [name for name in units_m if MOST < ratio[name] <= WIDEST and stated in (None, name)]
    if not wide or (fits and stated is None):
        raise fault
    return ScanUnit(tuple((name, units_m[name]) for name in wide), fault)


def _other_size(
    size: float, blank_m: float, units_m: Mapping[str, float], stated: str | None, fits: list[str], where: str
) -> InputError:
    limit = f"about {blank_m / MM:.4g} mm, the diagonal of the blank ({LEAST:g} to {MOST:g} times it)"
    remedy = "Cut away what was scanned beside it, or give its pose: --datum-points"
    if stated is not None:
        other = f"In {fits[0]} it would fit: give --unit {fits[0]}" if fits else "It fits in no unit: is it this part?"
        return InputError(
            f"the scan is of another size than the blank, if its unit is {stated}",
            where=where,
            value=f"{size * units_m[stated] / MM:.4g} mm across",
            limit=limit,
            hint=other + ("" if fits else f" {remedy}"),
        )
    return InputError(
        "the scan does not fit the blank in any unit",
        where=where,
        value=", ".join(f"{size * unit / MM:.4g} mm across in {name}" for name, unit in units_m.items()),
        limit=limit,
        hint=f"Is it a scan of this part? {remedy}; or give --unit",
    )
