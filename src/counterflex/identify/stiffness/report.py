"""Figures, pictures and sentences of a stiffness identification."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.units import MM, UM, UM_PER_KN
from counterflex.identify.counted_coverage import COUNTED
from counterflex.identify.pulls.blocks import PullLayout
from counterflex.identify.pulls.pulls import Pulls
from counterflex.identify.recipe import Curve, Figure, Picture
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import HeldOut
from counterflex.identify.stiffness.piecewise_compliance import PiecewiseSearch
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import deflection, linear_gap

WELL: Final = 0.2
"""Relative standard deviation up to which a compliance counts as well determined."""
POORLY: Final = 0.35
"""Relative standard deviation from which a compliance counts as poorly determined, whatever its prior."""
_NAMED = 5
_ROWS = 400


def headline(held_out: HeldOut, measured: Sequence[Float]) -> tuple[Figure, ...]:
    """Error of held-out pulls: in all, at worst, and in the median.

    Args:
        held_out: Errors of the rows, m.
        measured: Per block (n, k) measured displacement, m.
    """
    size = sizes(held_out, measured)
    keep = ~held_out.gross
    total = float(np.sum(size[keep]))
    errors = {"identified": held_out.identified[keep], "nominal": held_out.nominal[keep]}
    share = {key: 100.0 * float(np.sum(e)) / total for key, e in errors.items()}
    worst = {key: float(np.max(e)) / MM for key, e in errors.items()}
    median = {key: 100.0 * float(np.median(e / size[keep])) for key, e in errors.items()}
    return (
        Figure(
            "holdout_unexplained_percent",
            "deflection of held-out pulls that is not explained: sum |measured - predicted| / sum |measured|",
            share["identified"],
            share["nominal"],
        ),
        Figure(
            "holdout_explained_percent",
            "deflection of held-out pulls that is explained",
            100.0 - share["identified"],
            100.0 - share["nominal"],
        ),
        Figure("holdout_worst_mm", "largest vector error of a held-out pull", worst["identified"], worst["nominal"]),
        Figure(
            "holdout_median_percent",
            "median error of a held-out pull, relative to its deflection",
            median["identified"],
            median["nominal"],
        ),
    )


def sizes(held_out: HeldOut, measured: Sequence[Float]) -> Float:
    """(n,) length of the measured displacement of each held-out row, m."""
    out: Float = np.array(
        [np.linalg.norm(measured[b][r, :3]) for b, r in zip(held_out.block, held_out.row, strict=True)],
        dtype=np.float64,
    )
    return np.maximum(out, 1e-12)


def figures(chain: ElasticChain, pulls: Sequence[Pulls], fit: Fit, held_out: HeldOut) -> tuple[Figure, ...]:
    """Further figures."""
    gaps = []
    for p in pulls:
        every = max(1, len(p) // _ROWS)
        q, w = p.q[::every], p.w_tcp_base[::every]
        plain = deflection(chain, q, w, equilibrium=True)
        weight = deflection(chain, q, w, gravity=True, equilibrium=True)
        second = linear_gap(chain, q, w, equilibrium=True)
        gaps.append([np.linalg.norm(v[:, :3], axis=1).max() for v in (weight - plain, second)])
    of_weight, of_second = np.max(np.array(gaps), axis=0)
    return (
        Figure("pulls", "pulls used", float(sum(len(p) for p in pulls))),
        Figure("holdout_pulls", "pulls that the error on data not used rests on", float(held_out.count)),
        Figure("weight_um", "largest part of a deflection that own weight adds (second order)", float(of_weight) / UM),
        Figure(
            "second_order_um",
            "largest difference between the linear and the nonlinear deflection",
            float(of_second) / UM,
        ),
        Figure("condition", "condition number of the weighted Jacobian", fit.condition),
    )


def remarks(
    chain: ElasticChain,
    plan: PullLayout,
    fit: Fit,
    held_out: HeldOut,
    pulls: Sequence[Pulls],
    pieces: PiecewiseSearch | None,
) -> tuple[str, ...]:
    """Remarks: what the data determine and what not, which rows are doubtful, what was assumed."""
    out = [*_determined(plan, fit, held_out), COUNTED["stiffness"].text, *fit.hidden, *_doubtful(fit, pulls)]
    unknown = [p.name for p in pulls if not p.history]
    if unknown and chain.play is not None:
        out.append(
            f"{', '.join(unknown)}: the manifest does not state how the axes moved between the readings "
            f"(settings.history); the effect of play and friction of the cell file was added to the standard deviations"
        )
    if pieces is not None and pieces.regions:
        for i, region in enumerate(pieces.regions):
            value = fit.value(region.name)
            out.append(
                f"{region.text}: the compliance changes by {100.0 * value:+.0f} % over the range measured; the error "
                f"on data not used falls from {pieces.error[i] / UM:.0f} to {pieces.error[i + 1] / UM:.0f} um"
            )
        if any(region.axis >= 0 for region in pieces.regions):
            out.append(
                "The cell file gets the dependence on angles as [[robot.elastic_region]]: plans, the online loop and "
                "deflection use it, fading to the mean outside the angles of these pulls"
            )
        if any(region.axis < 0 for region in pieces.regions):
            out.append(
                "The cell file gets the dependence on loads as [[robot.compliance_curve]]: plans use it; the online "
                "loop, sag and the search for postures take the mean compliance"
            )
    return tuple(out)


def _determined(plan: PullLayout, fit: Fit, held_out: HeldOut) -> list[str]:
    well, fair, poor, unseen = [], [], [], []
    for k, item in enumerate(plan.springs.parameters):
        if not item.free:
            continue
        value = max(float(fit.values[k]), 1e-300)
        spread = _between_folds(held_out, k)
        relative = float(fit.sigma[k]) / value
        text = f"{item.name} ({100.0 * relative:.0f} %"
        text += f", {100.0 * spread:.0f} % between folds)" if np.isfinite(spread) else ")"
        if relative > 1.0:
            most, unit = fit.values[k] + 2.0 * fit.sigma[k], "um/kN" if item.unit == "m/N" else "urad/kNm"
            text = f"{item.name} (at most {most / UM_PER_KN:.3g} {unit})"
        if fit.seen[k] == "prior":
            unseen.append(item.name)
        elif max(relative, spread if np.isfinite(spread) else 0.0) <= WELL and fit.seen[k] == "determined":
            well.append(text)
        elif relative >= POORLY or (np.isfinite(spread) and spread >= POORLY):
            poor.append(text)
        else:
            fair.append(text)
    out = []
    for names, words in (
        (well, "The data determine well (standard deviation)"),
        (fair, "The data determine within limits"),
        (poor, "Poorly determined, not to be used on their own"),
        (unseen, "Not determined by these data, kept at the former value"),
    ):
        if names:
            out.append(f"{words}: {', '.join(names)}")
    return out


def _between_folds(held_out: HeldOut, place: int) -> float:
    """Range of a value between the fits of the folds, relative to its mean; NaN where there is one fit only."""
    if len(held_out.fits) < 2:
        return float("nan")
    values = np.array([f.values[place] for f in held_out.fits])
    return float(np.ptp(values) / max(float(np.mean(values)), 1e-300))


def _doubtful(fit: Fit, pulls: Sequence[Pulls]) -> list[str]:
    """Rows that count less, and in any case the worst of each dataset."""
    out = []
    for p, rows, weight in zip(pulls, fit.residuals, fit.weights, strict=True):
        error = np.linalg.norm((rows * p.d_sigma)[:, :3], axis=1)
        size = np.linalg.norm(p.d[:, :3], axis=1)
        worst = np.argsort(-error)[:_NAMED]
        named = ", ".join(
            f"line {int(p.line[i])} ({error[i] / MM:.2f} of {size[i] / MM:.2f} mm, weight {weight[i]:.2f})"
            for i in worst
        )
        out.append(f"{p.name}: the rows that fit worst are {named}; {int(np.sum(weight < 1.0))} rows count less")
    return out


def pictures(held_out: HeldOut, measured: Sequence[Float], plan: PullLayout, fit: Fit) -> tuple[Picture, ...]:
    """Error of held-out pulls over their deflection, and what was found against what was known."""
    size = sizes(held_out, measured) / MM
    springs = [k for k, p in enumerate(plan.springs.parameters) if p.free and p.nominal > 0.0]
    place = np.arange(1.0, len(springs) + 1.0)
    ratio = np.array([fit.values[k] / plan.parameters.items[k].nominal for k in springs])
    sigma = np.array([fit.sigma[k] / plan.parameters.items[k].nominal for k in springs])
    names = ", ".join(f"{i + 1} {plan.parameters.items[k].name}" for i, k in enumerate(springs))
    out = [
        Picture(
            "Held-out pulls",
            "measured deflection / mm",
            "error / mm",
            (
                Curve("with the cell file as it was", size, held_out.nominal / MM),
                Curve("identified", size, held_out.identified / MM),
            ),
            "Every point is a held-out pull.",
        )
    ]
    if springs:
        out.append(
            Picture(
                "Compliance found",
                "element",
                "compliance / value before",
                (
                    Curve("found", place, ratio),
                    Curve("one standard deviation above", place, ratio + sigma),
                    Curve("one standard deviation below", place, ratio - sigma),
                ),
                names,
            )
        )
    return tuple(out)
