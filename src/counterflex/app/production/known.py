"""How well the cell file's constants of the force law are known: by its ``[[identified]]`` entries."""

from __future__ import annotations

import math
from typing import Final

from counterflex.app.unknowns import IDENTIFIED
from counterflex.core.units import N_PER_MM
from counterflex.files.cell.cell import Cell
from counterflex.identify.cutting.force_forms import NAMES

RECIPES: Final = ("cutting", "production")


def known_constants(cell: Cell) -> dict[str, float]:
    """Standard deviations of identified constants by name, for the weight of the stated values.

    Of k relative, of m as it is, of e in N/m; to those of k :data:`IDENTIFIED` is added, what another edge, blank or
    day makes of an identified constant. Empty with handbook constants.
    """
    entry = next((e for e in reversed(cell.tables.identified) if e.recipe in RECIPES), None)
    out: dict[str, float] = {}
    for one in () if entry is None else entry.values:
        if one.name in NAMES[:3] and one.value != 0.0:
            out[one.name] = math.hypot(one.sigma / abs(one.value), IDENTIFIED)
        elif one.name in NAMES[3:6]:
            out[one.name] = max(one.sigma, 1e-3)
        elif one.name in NAMES[6:]:
            out[one.name] = max(one.sigma * N_PER_MM if one.unit == "N/mm" else one.sigma, 1.0)
    return out
