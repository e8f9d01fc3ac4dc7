"""Stiffness of an end effector (spindle, bracket, holder) of which none is stated, from published ones.

Two are published: the spindle with its holder of Haehn and Weigold 2020 (KR 300 R2500 ultra), and the spindle holder of
Denkena and Lepper 2015. The prior is one spring, equal about three axes, at the first body that states nothing.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from counterflex.core.arrays import Float

_HAEHN_NM_PER_RAD: Final = (1.9e5, 6.7e4, 9.1e4)
"""About x, y, z: Haehn2020 table 1, spindle and holder."""
_DENKENA_M_PER_N: Final = (0.125e-6, 0.137e-6)
"""Across the tool, at its tip: Denkena2015 table 1, without strain gauges."""
_DENKENA_LEVER_M: Final = 0.25
"""From the flange to the tip: not published; as such spindles are. A third more or less is 30 % of the median."""
_FACTOR_90: Final = 6.0
"""Nine of ten lie between median / 6 and median * 6: a judgement, the two published ones lie a factor of 4.4 apart."""
_INSIDE_SIGMA: Final = 1.645


def median_nm_per_rad() -> float:
    """Return the median stiffness: the geometric mean of the published end effectors, N m/rad."""
    haehn = float(np.exp(np.mean(np.log(_HAEHN_NM_PER_RAD))))
    denkena = _DENKENA_LEVER_M**2 / float(np.mean(_DENKENA_M_PER_N))
    return float(np.sqrt(haehn * denkena))


def drawn(count: int, seed: int) -> Float:
    """Return stiffnesses (count,) N m/rad of end effectors that nothing is known of."""
    z = np.random.default_rng(seed).standard_normal(count)
    out: Float = median_nm_per_rad() * np.exp(np.log(_FACTOR_90) / _INSIDE_SIGMA * z)
    return out
