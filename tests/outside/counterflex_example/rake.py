"""A force law: Kienzle's, corrected for the rake angle of the tool."""

from __future__ import annotations

from collections.abc import Mapping

from counterflex.core.units import DEG, N_PER_MM2
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw
from counterflex.cutting.force_laws import LawKind, ValidFor
from counterflex.cutting.material import rake_factor


def build(values: Mapping[str, float], valid: ValidFor) -> ForceLaw:
    """``F'_i(h) = K k_i1.1 h^(1-m)``, ``K = 1 - (gamma - gamma_0) / 100``, angles in deg in the formula.

    Args:
        values: Of ``[material.parameters]``, in the units that the keys name.
        valid: Range of chip thickness, source and status.
    """
    law = KienzleLaw.with_ratios(
        values["kc11_n_mm2"] * N_PER_MM2,
        values["mc"],
        kr_over_kc=values["kr_over_kc"],
        ka_over_kc=values["ka_over_kc"],
        h_min_m=valid.h_min_m,
        h_max_m=valid.h_max_m,
        source=valid.source,
        status=valid.status,
    )
    return law.scaled(rake_factor(values["rake_deg"] * DEG, values["base_rake_deg"] * DEG))


LAW = LawKind(
    "Kienzle with a rake angle",
    build,
    {
        "kc11_n_mm2": (10.0, 20000.0),
        "mc": (0.0, 0.9),
        "kr_over_kc": (0.0, 5.0),
        "ka_over_kc": (-5.0, 5.0),
        "rake_deg": (-30.0, 30.0),
        "base_rake_deg": (-30.0, 30.0),
    },
)
