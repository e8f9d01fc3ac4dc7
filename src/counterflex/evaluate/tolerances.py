"""General tolerances for features whose drawing gives none: ISO 2768-1 m and ISO 2768-2 K.

ISO 2768-2 was withdrawn in 2021. ISO 22081, which replaces it, has no tables: a drawing states its own values. The
zones of part 2 are kept for drawings that name 2768-mK, and each row that stands on them says so.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.arrays import as_positive
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM

SIZES: Final = "ISO 2768-1 m"
FORM: Final = "ISO 2768-2 K (withdrawn, see ISO 22081)"
"""Sources of tolerances that no drawing gave, as printed: of sizes and places, of flatness and roundness."""
# Upper end of the nominal range in mm -> +- tolerance in mm, class m (medium), ISO 2768-1 table 1
_LINEAR_M: Final = ((3.0, 0.1), (6.0, 0.1), (30.0, 0.2), (120.0, 0.3), (400.0, 0.5), (1000.0, 0.8), (2000.0, 1.2))
# Longest side in mm -> tolerance zone in mm, class K, ISO 2768-2 table 1
_FLAT_K: Final = ((10.0, 0.05), (30.0, 0.1), (100.0, 0.2), (300.0, 0.4), (1000.0, 0.6), (3000.0, 0.8))


def linear_m(nominal_m: float) -> float:
    """Permitted deviation of a length, +- m: ISO 2768-1, class m.

    Args:
        nominal_m: Nominal size, m, up to 2 m; sizes below 0.5 mm get the tolerance of the smallest range.

    Raises:
        InputError: The size is negative or beyond the table.
    """
    return _look_up(_LINEAR_M, nominal_m)


def flatness_k(side_m: float) -> float:
    """Width of the zone a flat surface must lie in, m: ISO 2768-2 (withdrawn), class K, by its longest side to 3 m."""
    return _look_up(_FLAT_K, side_m)


def _look_up(table: tuple[tuple[float, float], ...], size_m: float) -> float:
    size = as_positive("nominal size", size_m, zero=True)
    for limit, tolerance in table:
        if size <= limit * MM + UM:  # sizes measured on a map come with its rounding
            return tolerance * MM
    raise InputError("size is beyond the table of general tolerances", value=size, limit=f"<= {table[-1][0] * MM:g} m")
