"""Outcome of an identification: better values, former values confirmed, or refused."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from counterflex.core.errors import ModelError
from counterflex.files.shop_unit import unit_of_name
from counterflex.identify.data.changes import TableValues
from counterflex.identify.recipe import Figure, Identification
from counterflex.identify.solver.agreement import agreement, contradicted
from counterflex.identify.solver.fit import Fit

Outcome = Literal["better", "confirmed"]
GAIN: Final = 0.02
"""Share by which the error on data not used has to fall for values that agree with the former ones to replace them."""
_MOST_NAMED: Final = 5
_PLACES: Final = ("tracker",)
"""Tables of where something stands during these measurements: there is no former value to keep."""


def judged(result: Identification, *, separate: bool) -> tuple[Identification, Outcome]:
    """Decide what goes into the cell file.

    ``separate``: The error on data not used comes from data of their own (``--holdout``).

    Returns:
        The result with what is said about it, and ``better`` (its values go into the cell file) or ``confirmed`` (the
        data agree with the cell file within noise: the values there stay, with the standard deviations found).

    Raises:
        ModelError: The values predict data not used worse than the cell file does, by more than noise, or there is no
            such figure.
    """
    first = _first(result)
    against = [line for fit in result.fits.values() for line in _against(fit)]
    result = replace(result, remarks=(*against, *result.remarks))
    if first.nominal is None:
        return result, "better"
    compared = f"{first.text}: {first.value:.4g} {unit_of_name(first.name)}, {first.nominal:.4g} with the former values"
    if first.value <= (1.0 - GAIN) * first.nominal:
        return result, "better"
    match = agreement(result.fits.values())
    nothing = f"No gain on {'the data of --holdout' if separate else 'data not used'} ({compared})."
    if match.agrees and match.directions and first.value <= match.growth * first.nominal:
        remark = (
            f"Confirmed: the data agree with the cell file within noise (probability of a larger difference "
            f"{match.chance:.2g}; {compared}). Its values stay; their standard deviations are those found now."
        )
        return confirmed(replace(result, remarks=(remark, *result.remarks))), "confirmed"
    if first.value <= first.nominal:
        return replace(result, remarks=(nothing, *result.remarks)), "better"
    raise _worse(result, first, nothing)


def confirmed(result: Identification) -> Identification:
    """The result with the former values in place of the fitted ones.

    The standard deviation of a former value is ``hypot(sigma, fitted - former)``: it holds the distance of both.
    """
    fits = {}
    for name, fit in result.fits.items():
        known = np.array([p.free and p.has_prior for p in fit.parameters], dtype=np.bool_)
        former = np.where(known, fit.parameters.nominal, fit.values)
        fits[name] = replace(fit, values=former, sigma=np.hypot(fit.sigma, fit.values - former))
    placed = tuple(c for c in result.changes if isinstance(c, TableValues) and c.table in _PLACES)
    return replace(result, fits=fits, changes=placed)


def _first(result: Identification) -> Figure:
    if not result.headline:
        raise ModelError("the recipe gave no error on data not used", where=result.recipe)
    first = result.headline[0]
    if not math.isfinite(first.value):
        raise ModelError("the error on data not used is not a number", where=result.recipe, value=first.value)
    return first


def _against(fit: Fit) -> list[str]:
    """A sentence where the data contradict the priors."""
    off = contradicted(fit)
    if not off:
        return []
    named = ", ".join(f"{name} ({distance:.1f})" for name, distance in off[:_MOST_NAMED])
    more = f" and {len(off) - _MOST_NAMED} more" if len(off) > _MOST_NAMED else ""
    return [
        f"The data contradict what was known before, in standard deviations of that: {named}{more}. Check units, signs "
        "and columns; if the data are right, the former values or their standard deviations were wrong."
    ]


def _worse(result: Identification, first: Figure, nothing: str) -> ModelError:
    lines = "; ".join(
        f"{f.text}: {f.value:.4g}" + ("" if f.nominal is None else f", before {f.nominal:.4g}") for f in result.headline
    )
    return ModelError(
        "the identified values predict data not used worse than the cell file does; nothing was written",
        where=result.recipe,
        value=f"{first.name} = {first.value:.4g}",
        limit=f"at most {first.nominal:.4g} (with the values of the cell file)",
        hint=f"{nothing} {lines}. Measure more or better, or check units, signs and frames in the manifest",
    )
