"""What a plan says of each of its rows, as far as a measured force is compared with it.

The planner's mean force is linear in the constants: for a power term ``k h^p`` it is ``B(p) (k_c, k_r, k_a)`` with a
map B (3 x 3) that depends on the exponent, the engagement booked in the plan's blank, and the feed per tooth. Kept are
maps without the size of the chip, ``U(p) = B(p) h0^-p`` in m, at the exponents :data:`EXPONENTS`; between them U is the
polynomial through these, exact to 0.03 % for chips within a factor of three of h0 (tests).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import UM

EXPONENTS: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Exponents p of the terms whose maps are kept: 0 is the edge force, 1 the linear law."""
CHIP_M: Final = 50.0 * UM
"""h0, a chip thickness in the middle of those that milling has."""

_ORDERS: Final = np.arange(len(EXPONENTS), dtype=np.float64)
_BASIS: Final = np.linalg.inv(np.vander(np.array(EXPONENTS), increasing=True))
"""Row j: share of the monomial p^j in the polynomial that is 1 at each node and 0 at the others."""


@dataclass(frozen=True, eq=False)
class PlannedCut:
    """A plan as production identification reads it; n rows, row i: the segment that ends there. Part axes, SI.

    Attributes:
        p_part: (n, 3) points as the program sends them, the correction it contains included.
        time_s: (n,) planned time.
        tool: (n,) number of the tool.
        motion: (n,) motion of the program.
        cutting: (n,) rows at feed that take material.
        direction: (n, 3) unit vector of the feed, zero where the tool stands.
        axis_z: (n,) z of the unit vector along the tool, in part axes.
        feed_m_s: (n,) planned feed.
        spindle_rad_s: (n,) of the spindle.
        feed_tooth_m: (n,) feed per tooth.
        depth_m: (n,) largest engaged axial depth.
        entry_rad: (n,) where the engagement begins, NaN out of the cut.
        exit_rad: (n,) where it ends.
        volume_m3: (n,) removed.
        f_part: (n, 3) N, force that the plan predicts.
        maps_m: (n, 3, 3, k) U at :data:`EXPONENTS`: force x, y, z by the constants c, r, a; zero out of the cut.
        contained_part: (n, 3) m, correction that the program contains.
        cell_m: Grid of the plan's blank: how well a width is known.
    """

    p_part: Float
    time_s: Float
    tool: Int
    motion: Int
    cutting: Bool
    direction: Float
    axis_z: Float
    feed_m_s: Float
    spindle_rad_s: Float
    feed_tooth_m: Float
    depth_m: Float
    entry_rad: Float
    exit_rad: Float
    volume_m3: Float
    f_part: Float
    maps_m: Float
    contained_part: Float
    cell_m: float


@dataclass(frozen=True, eq=False)
class RunRecord:
    """A run as its log has it, m cycles of one run in order. Part axes, SI.

    Attributes:
        name: Of the run, for messages.
        time_s: (m,) of the controller's clock, rising.
        p_part: (m, 3) m, commanded place, without what was corrected online.
        w_part: (m, 6) N, N m, wrench of the process on the tool about its tip: the weight behind the sensor and the
            zero before the cut are taken off.
        q: (m, 6) rad.
        online_part: (m, 3) m, correction that was sent.
        good: (m,) cycles with a telegram and a good reading of the force.
        saturated: (m,) cycles in which the force sensor was beyond its range.
        period_s: Of the controller.
    """

    name: str
    time_s: Float
    p_part: Float
    w_part: Float
    q: Float
    online_part: Float
    good: Bool
    saturated: Bool
    period_s: float


def weights_at(p: float) -> tuple[Float, Float]:
    """(k,) Lagrange weights of the nodes :data:`EXPONENTS` at an exponent, and their derivatives by it."""
    power = p**_ORDERS
    slope = np.concatenate([[0.0], _ORDERS[1:] * power[:-1]])
    return power @ _BASIS, slope @ _BASIS


def force_of(maps_m: Float, terms: Float) -> Float:
    """Force of a law: (n, 3) N.

    Args:
        maps_m: (n, 3, 3, k), see :class:`PlannedCut`.
        terms: (t, 4) rows (p, k_c, k_r, k_a), as :meth:`counterflex.cutting.coefficients.ForceLaw.terms` gives them.
    """
    out = np.zeros(maps_m.shape[:2])
    for p, *k in terms:
        out += (maps_m @ weights_at(float(p))[0] @ np.array(k)) * CHIP_M ** float(p)
    return out
