"""Figures that a plan begins with: path error with all that is not known, and lines that compensation makes worse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.app.prediction_interval import headline_text, worse_text
from counterflex.core.units import MM, UM
from counterflex.cutting.coefficients import ForceLaw
from counterflex.plan.chip_range import uncertainty
from counterflex.plan.plan import Plan, across
from counterflex.report.data import Headline

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


LISTED: Final = 6
"""Most lines that a warning names."""
_WORSE_M: Final = 1.0 * UM  # A line counts as worse from here on: programs are written to a micrometre


def worse_lines(plan: Plan) -> list[dict[str, Any]]:
    """Lines whose largest predicted path error is larger with compensation than without, the worst first."""
    if np.any(np.isnan(plan.deviation_compensated_part)):
        return []
    before, after = (
        np.linalg.norm(across(deviation, plan.path.p_part_tcp), axis=1)
        for deviation in (plan.deviation_nominal_part, plan.deviation_compensated_part)
    )
    line = plan.line[plan.judged]
    numbers, group = np.unique(line, return_inverse=True)  # one pass: a program has as many lines as points
    most, left = (np.zeros(len(numbers)) for _ in range(2))
    np.maximum.at(most, group, before[plan.judged])
    np.maximum.at(left, group, after[plan.judged])
    rows = [
        {"line": int(numbers[k]), "before_mm": round(float(most[k]) / MM, 4), "after_mm": round(float(left[k]) / MM, 4)}
        for k in np.flatnonzero(left > most + _WORSE_M)
    ]
    return sorted(rows, key=lambda row: float(row["before_mm"]) - float(row["after_mm"]))


def worse_warnings(rows: list[dict[str, Any]]) -> list[str]:
    """The same in words; empty where no line gets worse."""
    if not rows:
        return []
    worst = rows[0]
    return [
        f"compensation makes the predicted error larger in line {named_lines(rows)}: most in line {worst['line']}, "
        f"from {worst['before_mm']:.3f} to {worst['after_mm']:.3f} mm"
    ]


def error_rows(predicted: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Name, value, remark of the predicted path errors, the figures to plan with first; none without a prediction."""
    if "predicted_compensated" not in predicted:
        return []
    rows: list[tuple[str, str, str]] = []
    headline, share = predicted.get("headline"), "99.7 % of the path in the cut"
    if headline is not None:
        rows = [
            (f"Expected path error {what}", headline_text(headline[f"{what}_mm"]), share + _calibration(headline, what))
            for what in ("before", "after")
        ]
        worse = worse_text(headline["probability_of_worse"])
        rows.append(("Probability that compensation makes it worse", worse, "by all that is not known of the cell"))
        if headline.get("sharp_corners"):
            remark = "not looked at: the range does not hold the speed that the controller chooses there"
            rows.append(("Sharp corners in the cut", str(headline["sharp_corners"]), remark))
    for name, what in (("nominal", "before"), ("compensated", "after")):
        error = predicted[f"predicted_{name}"]
        text = f"{error['p997_mm']:.3f} mm, largest {error['max_mm']:.3f} mm"
        rows.append((f"Model without its unknowns, {what}", text, share))
    return rows


def _calibration(headline: Mapping[str, Any], what: str) -> str:
    """Source of the width of a range; empty in a summary that does not say it."""
    if "calibration" not in headline:
        return ""
    calibration = headline["calibration"]
    if calibration is None:
        return "; range as drawn, not calibrated"
    factors = " and ".join(f"{factor:.2f}" for factor in calibration[what])
    return f"; range calibrated on {calibration['text']}: logarithms of its ends about the median times {factors}"


def headline_of(prediction: Mapping[str, Any]) -> Headline:
    """The figures to plan with; those of the model alone where the unknowns were not counted."""
    first, last = prediction["predicted_nominal"], prediction["predicted_compensated"]
    model = (first["p997_mm"], last["p997_mm"])
    headline = prediction.get("headline")
    if headline is None:
        return Headline(model)
    worse = worse_text(headline["probability_of_worse"])
    return Headline(model, tuple(headline["before_mm"]), tuple(headline["after_mm"]), worse)


def named_lines(rows: list[dict[str, Any]]) -> str:
    """Numbers of the first lines."""
    return ", ".join(str(row["line"]) for row in rows[:LISTED]) + (", ..." if len(rows) > LISTED else "")
