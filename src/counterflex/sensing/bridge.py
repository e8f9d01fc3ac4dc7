"""The Wheatstone full bridge: its voltage from four strains, and the strain behind a voltage.

Four gauges R1 to R4 around a square, supply across one diagonal, signal across the other. R1 and R3 lie along the
strain, R2 and R4 across it (Denkena2015 fig. 4): ``U / U_s = R1 / (R1 + R2) - R4 / (R3 + R4)`` with
``R_i = R (1 + k eps_i)``; to first order ``k (eps1 - eps2 + eps3 - eps4) / 4``, in which equal thermal strain cancels.
"""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive

SUPPLY_V = 5.0
GAUGE_FACTOR = 2.0


def bridge_voltage(strain: Float, *, gauge_factor: float = GAUGE_FACTOR, supply_v: float = SUPPLY_V) -> Float:
    """Signal of a full bridge, without linearising.

    ``strain``: (..., 4) of R1 to R4, R1 and R3 active, R2 and R4 across.

    Returns:
        (...) V.
    """
    r = 1.0 + as_positive("gauge_factor", gauge_factor) * as_float("strain", strain)
    out: Float = as_positive("supply_v", supply_v) * (
        r[..., 0] / (r[..., 0] + r[..., 1]) - r[..., 3] / (r[..., 2] + r[..., 3])
    )
    return out


def strain_of_voltage(
    voltage_v: Float,
    *,
    poisson_ratio: float = 0.3,
    gauge_factor: float = GAUGE_FACTOR,
    supply_v: float = SUPPLY_V,
) -> Float:
    """Strain of a bar in tension that gives this signal: ``2 U / (U_s k (1 + nu))``.

    ``voltage_v``: (...) V. ``poisson_ratio``: Of the body: what the gauges across it see.

    Returns:
        (...) dimensionless. Off by less than 1e-3 of itself below 1000 um/m.
    """
    out: Float = 2.0 * np.asarray(voltage_v, dtype=np.float64) / (supply_v * gauge_factor * (1.0 + poisson_ratio))
    return out
