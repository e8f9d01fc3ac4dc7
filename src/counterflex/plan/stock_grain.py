"""Grain of the stock that is fine enough for a tool that bends: its cells must not shake the tool.

A trial cuts the stock in steps much shorter than a cell, so a step finds a whole number of cells and its force is
uneven. A mode of angular frequency w takes the mean over about ``1/w``, in which a mill of diameter D at feed v removes
``N = D v / (w c^2)`` cells of side c; what remains is ``1/sqrt(N)`` of the force, of which the arm makes

    grain = K |u| c sqrt(w / (D v)),

with u the deflection under the undisturbed force. K is measured: :data:`SHARE`. In a deep groove (1.1 mm deflection,
16 mm, 25 mm/s, 8.7 Hz) it is 37 um in cells of 0.2 mm, and the trial cannot tell it from a swing of the arm: what it
then takes back is the grain of its own stock. Shallow cuts of stiff arms need no finer stock.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.units import MM, UM
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tilted_stock import UPRIGHT
from counterflex.path.toolpath import ToolPath

SHARE: Final = 0.45
"""K: by the rms deviation of trials of a groove in cells of 0.05 to 0.2 mm."""
TILTED_SHARE: Final = 0.06
"""The same for a tilted or turning tool, whose edge enters a column of the stock little by little: a twisted channel
of the depth above differs by 3.5 um between trials in cells of 0.2 and of 0.1 mm."""
GRAIN_M: Final = 20.0 * UM
"""Grain that is let stand: half of it costs four times the time of a trial and left no less in the simulated cells."""
FINEST_M: Final = 0.05 * MM
"""No cell is made smaller than this."""
WHOLE_M: Final = 0.08 * MM
"""Whole divisions down to this size; a block that needs smaller cells gets them as large as the grain allows. The
demonstration (26 um in cells of 0.1 mm) is planned in cells of 0.077 mm, in 1.7 times the time instead of 4."""
MOST_CELLS: Final = 40_000_000
"""Most cells of the finer stock."""


def grain_per_cell(
    path: ToolPath, deflection_part: Float, contact: Bool, cutter_of: Callable[[int], Cutter], omega_rad_s: float
) -> float:
    """Largest grain of a path over the side of a cell, ``max K |u| sqrt(w / (D v))``.

    Args:
        path: n rows.
        deflection_part: (n, 6) m, rad, at rest, under the force of the undisturbed cut.
        contact: (n,) rows that cut.
        cutter_of: Gives the cutter of a tool number.
        omega_rad_s: Of the lowest mode; 0 where nothing swings.
    """
    size, worst = np.linalg.norm(deflection_part[:, :3], axis=1), 0.0
    for number in np.unique(path.tool[contact]):
        on = contact & (path.tool == number) & (path.feed_m_s > 0.0)
        swept = cutter_of(int(number)).diameter_m * path.feed_m_s[on]
        share = SHARE if np.all(path.axis_part[on, 2] >= UPRIGHT) else TILTED_SHARE
        worst = max(worst, float(np.max(share * size[on] * np.sqrt(omega_rad_s / swept), initial=0.0)))
    return worst


def fine_enough(stock: HeightMap, grain_share: float) -> HeightMap:
    """The stock in cells of a grain up to :data:`GRAIN_M`, as far as :data:`FINEST_M` and :data:`MOST_CELLS` let it.

    Args:
        stock: As it is; returned where it is fine enough.
        grain_share: Of :func:`grain_per_cell`.
    """
    if grain_share * stock.cell_m <= GRAIN_M:
        return stock
    needed_m = GRAIN_M / grain_share
    least_m = max(FINEST_M, stock.cell_m * math.sqrt(stock.z.size / MOST_CELLS))
    times = math.ceil(stock.cell_m / needed_m)
    if stock.cell_m / times < WHOLE_M and stock.z.min() == stock.z.max():
        # One division more than asked would pass the limit by a hair: 1 % is far below what the grain is known to.
        cell_m = max(needed_m, 1.01 * least_m)
        return stock.finer_block(cell_m) if cell_m < stock.cell_m else stock
    # No finer than memory bears: a coarse grain only makes the trial uneven.
    times = min(times, int(stock.cell_m / least_m))
    return stock if times <= 1 else stock.finer(times)
