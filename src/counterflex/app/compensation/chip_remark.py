"""Chips outside the range of the cutting constants, as a figure of a plan and as a line for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.units import MM, UM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.plan.chip_range import uncertainty
from counterflex.plan.plan import Plan

WARNED_SHARE: Final = 0.02
"""Share of the force impulse outside the range from which the line is a warning, below it a note."""


def extrapolation(plan: Plan, law: ForceLaw) -> dict[str, Any] | None:
    """Return what chips outside the range do to a plan, in shop units; None where there are none or it is not known.

    The effect is the deflection that the distance between both readings of the force makes, see
    :mod:`counterflex.plan.chip_range`: so much of the correction may be wrong there.
    """
    rows, chip = plan.extrapolated == 1, plan.chip_m
    if chip is None or not np.any(rows):
        return None
    effect = np.where(rows, uncertainty(law, chip) * np.linalg.norm(plan.deflection_part[:, :3], axis=1), 0.0)
    worst = int(np.argmax(effect))
    return {
        "force_share": round(plan.extrapolated_share, 5),
        "effect_um": round(float(effect[worst]) / UM, 2),
        "line": int(plan.line[worst]),
        "mean_chip_mm": round(float(chip[worst]) / MM, 6),
        "range_mm": [law.h_min_m / MM, law.h_max_m / MM],
    }


def extrapolation_text(estimate: Mapping[str, Any] | None) -> str:
    """The same in words, with ``warning`` or ``note`` in front; empty where there is nothing to say."""
    if not estimate:
        return ""
    low, high = estimate["range_mm"]
    kind = "warning" if estimate["force_share"] > WARNED_SHARE else "note"
    return (
        f"{kind}: {100.0 * estimate['force_share']:.2g} % of the force comes from chips outside the range of the "
        f"cutting constants ({low:g} to {high:g} mm); it may make the correction wrong by "
        f"{estimate['effect_um']:.2g} um, most in line {estimate['line']} (mean chip {estimate['mean_chip_mm']:.3g} mm)"
    )
