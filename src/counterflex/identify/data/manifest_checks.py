"""Check data against their manifest: mistakes that a fit would otherwise hide.

A sign turned round, mm for m, swapped columns or a left-handed frame leave a fit with large residuals or with values
far from anything known before. Every other reading of the data
(:mod:`counterflex.identify.data.alternative_readings`) is fitted by the same quick fit; one that explains the data
far better is named, with both figures. The data are never repaired.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, InputError
from counterflex.identify.data.alternative_readings import AlternativeReading
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.solver.fit import Fit

RATIO: Final = 2.0
"""How many times smaller the median residual must be in another reading. What the model lacks sets a floor: on pulls of
a real robot a wrong sign of one component leaves 2.9 times that floor, rows out of step 2.1; right data, read wrongly,
leave more than read rightly."""
CLOSER: Final = 3.0
"""How many times closer to what is known before another reading must bring the values."""
CHANCE: Final = 1e-3
"""Largest probability that it does so by chance, all readings tried taken together."""
PLAUSIBLE: Final = 2.0
"""Misfit (residuals over their standard deviations, values over their priors) that needs no other reading."""
WORSE: Final = 1.2
"""Factor by which a reading with more plausible values may fit the rows worse."""
ALIKE: Final = 1.2
"""Readings within this factor of the best cannot be told apart."""
ROWS: Final = 60
"""Rows that are tried; more are thinned out evenly."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """Misfit of a quick fit to a dataset."""

    rows: Float  # (n,) size of each row's weighted residual, per root of the number of components
    priors: Float  # (f,) fitted values less nominal over prior sigma, of the parameters that have a prior
    dof: float  # measured numbers less what the data determine

    @property
    def size(self) -> float:
        """Median of the rows."""
        return float(np.median(self.rows)) if len(self.rows) else math.inf

    @property
    def surprise(self) -> float:
        """Root mean square of the priors' residuals: 1 is what the priors promise."""
        return float(np.sqrt(np.mean(self.priors**2))) if len(self.priors) else 0.0


Score = Callable[[Dataset], Misfit]
"""A cheap fit of a dataset, as stated or otherwise read; may raise a :class:`CounterflexError` where it cannot be."""


@dataclass(frozen=True)
class Suspicion:
    """Another reading that explains the data far better."""

    reading: AlternativeReading
    # misfit as stated: of the rows, or of the values against their priors; infinite where no fit is possible
    stated: float
    otherwise: float  # the same as read otherwise
    of_values: bool  # the figures are of the values, not of the rows
    chance: float  # probability of such a gain by chance
    alike: tuple[str, ...]  # what other readings do nearly as well

    def sentence(self) -> str:
        """The finding in words."""
        if self.of_values:
            figures = (
                f"as stated, the values are {self.stated:.3g} standard deviations from what is known of this "
                f"cell, so read {self.otherwise:.3g}"
            )
        elif math.isinf(self.stated):
            figures = f"as stated, no fit is possible at all, so read the residuals are {self.otherwise:.3g} sigma"
        else:
            figures = f"as stated, the residuals are {self.stated:.3g} sigma in median, so read {self.otherwise:.3g}"
        text = (
            f"the data suggest that {self.reading.says}: {figures} (chance of that below {max(self.chance, 1e-9):.1g})"
        )
        if self.alike:
            text += f"; as good: {'; '.join(self.alike)}"
        return text


def misfit_of(fit: Fit) -> Misfit:
    """The misfit that a fit leaves, all its blocks together."""
    u = fit.parameters.coordinates(fit.values)
    known = np.array([p.has_prior and p.free for p in fit.parameters], dtype=np.bool_)
    rows = [np.sqrt(np.mean(r**2, axis=1)) for r in fit.residuals]
    return Misfit(np.concatenate(rows), u[known], fit.dof)


def thinned(data: Dataset, count: int = ROWS) -> Dataset:
    """At most about ``count`` rows, evenly spread over the table."""
    if len(data) <= count:
        return data
    keep = np.zeros(len(data), dtype=np.bool_)
    keep[np.linspace(0, len(data) - 1, count).astype(np.int64)] = True
    return data.rows(keep)


def suspect(
    data: Dataset, readings: Sequence[AlternativeReading], score: Score, *, rows: int = ROWS
) -> Suspicion | None:
    """Look for another reading that explains a dataset far better than its manifest does.

    Nothing is tried where the stated reading leaves residuals and values within :data:`PLAUSIBLE`. Otherwise a reading
    is suspected where the median residual falls to less than 1 / :data:`RATIO`, with values no less plausible (F test
    of the squared ratio, both fits with their degrees of freedom), or where the values found come :data:`CLOSER` times
    closer to their priors while the rows fit as well (chi-square test of the priors as stated).

    Returns:
        The best other reading, or None.
    """
    sample = thinned(data, rows)
    stated = _scored(score, sample)
    # Not tried at all: with dozens of readings one fits good data a little better by chance, and would only alarm.
    if stated.size <= PLAUSIBLE and stated.surprise <= PLAUSIBLE:
        return None
    suspicions = []
    for reading in readings:
        other = _scored(score, reading.change(sample))
        suspicion = _compared(reading, stated, other, len(readings))
        if suspicion is not None:
            suspicions.append((other.size * max(1.0, other.surprise), suspicion))
    if not suspicions:
        return None
    suspicions.sort(key=lambda item: item[0])
    best, chosen = suspicions[0]
    alike = tuple(s.reading.says for value, s in suspicions[1:] if value <= ALIKE * best)
    return Suspicion(chosen.reading, chosen.stated, chosen.otherwise, chosen.of_values, chosen.chance, alike)


def check_reading(
    data: Dataset, readings: Sequence[AlternativeReading], score: Score, *, as_stated: bool = False, rows: int = ROWS
) -> tuple[str, ...]:
    """Refuse a dataset that another reading explains far better.

    ``as_stated``: The user insists (the recipe's setting ``as_stated``): the finding is returned as a remark. Returns
    remarks for the report; empty where nothing is suspected. Raises InputError: another reading is suspected and the
    user does not insist.
    """
    suspicion = suspect(data, readings, score, rows=rows)
    if suspicion is None:
        return ()
    if as_stated:
        return (f"{data.name}: {suspicion.sentence()}; used as stated, as requested",)
    raise InputError(
        suspicion.sentence(),
        where=f"{data.where or data.name}: channels.{suspicion.reading.channel}",
        hint=f"If so, {suspicion.reading.remedy}. If the data are right, add --set as_stated=true",
        suspicion=suspicion,
    )


def _scored(score: Score, data: Dataset) -> Misfit:
    try:
        return score(data)
    except CounterflexError:
        return Misfit(np.full(max(len(data), 1), np.inf), np.zeros(0), 0.0)


def _compared(reading: AlternativeReading, stated: Misfit, other: Misfit, count: int) -> Suspicion | None:
    if not math.isfinite(other.size):
        return None
    # Nothing fits better than its noise: below 1 the other reading has only used up its freedom.
    ratio = stated.size / max(other.size, 1.0)
    plausible = other.surprise <= max(PLAUSIBLE, stated.surprise)
    if ratio >= RATIO and plausible:
        if math.isinf(ratio):
            return Suspicion(reading, stated.size, other.size, False, 0.0, ())
        # Times the readings that were tried (Bonferroni): the best of many is better by chance.
        chance = count * float(scipy.stats.f.sf(ratio**2, max(stated.dof, 1.0), max(other.dof, 1.0)))
        if chance <= CHANCE:
            return Suspicion(reading, stated.size, other.size, False, chance, ())
    gain = stated.surprise / max(other.surprise, 1.0)
    if gain >= CLOSER and other.size <= WORSE * max(stated.size, 1.0):
        chance = count * float(scipy.stats.chi2.sf(np.sum(stated.priors**2), len(stated.priors)))
        if chance <= CHANCE:
            return Suspicion(reading, stated.surprise, other.surprise, True, chance, ())
    return None
