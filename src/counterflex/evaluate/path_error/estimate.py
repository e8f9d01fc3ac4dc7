"""The error of the tool's path from the deviations of one part, with its standard deviation; noise is left out.

Which stretch made a place depends on the errors themselves (see :mod:`.contacts`), so places are assigned to stretches
and the path is estimated in turn. Sizes and lengths of the error and the noise of the scan are those that make the
deviations most likely (largest evidence). A run of feed whose deviations are no likelier with an error of the path than
without one, by :data:`EVIDENCE`, has none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM, UM
from counterflex.evaluate.inspection.part_deviations import FREE, PartDeviations
from counterflex.evaluate.path_error import band_solver
from counterflex.evaluate.path_error.contacts import Contacts, Nodes

PATCH_M: Final = 2.0 * MM
_LEAST: Final = 4  # Points of a patch from which its mean says something
_FEW: Final = 12  # Patches below which nothing is said


def variance_inflation(residual_m: Float, sigma_m: Float, points: Float, face: Int) -> float:
    """By how much the variance of means is larger than of independent points, >= 1.

    Points of one face in one cube of :data:`PATCH_M` make a patch. Of independent residuals r with standard deviations
    s the mean of m has the variance s^2/m; the ratio of the mean squares, ``m mean(r/s)^2 / mean((r/s)^2)``, is 1 for
    them and m for residuals that are equal within a patch. Its median over the patches, divided by that of a
    chi-squared variable of one degree of freedom, is taken: it does not see single outliers.

    Args:
        residual_m: (n,) what an estimate of the path leaves of the deviations, m.
        sigma_m: (n,) their standard deviations without correlation.
        points: (n, 3) m.
        face: (n,) number of the face.
    """
    key = np.column_stack([np.floor(points / PATCH_M).astype(np.int64), face])
    patch = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    r = residual_m / sigma_m
    count, total = np.bincount(patch), np.bincount(patch, r)
    enough = count >= _LEAST
    if int(enough.sum()) < _FEW:
        return 1.0
    scatter = float(np.median(r**2) / 0.4549)
    means = total[enough] ** 2 / count[enough]
    return max(1.0, float(np.median(means) / 0.4549) / max(scatter, 1e-12))


EVIDENCE: Final = 6.0
"""Logarithm of the ratio of evidences from which an error is believed: e^6, four hundred to one."""
SIGMAS: Final = 2.0
"""An error smaller than so many of its standard deviations everywhere on a run is left alone."""
SEEN: Final = 0.5
"""A component is seen where its standard deviation is below this share of what it was before the measurement."""
_ROUNDS: Final = 6
_SIZED: Final = (1, 3, 5)
"""Rounds in which places are assigned anew, and those of them in which sizes and lengths are found."""
_TIE_M: Final = 4.0 * UM
"""Places that several stretches reach to this are shared out among them: no scan tells these apart. So well is known
which of them decides, and so it is in every standard deviation."""
_DRAWS: Final = 60
_SEED: Final = 20
_FREEDOM: Final = 5.0  # Of Student's distribution, by which outliers lose their weight
_LEAST_PLACES: Final = 50
_LEAST_SHARE: Final = 0.5  # Places, and share of the machined ones, that the program must have made
_SIGMA_M: Final = (0.3 * UM, 3.0 * MM)


@dataclass(frozen=True, eq=False)
class PathError:
    """Error of the tool's path that a measured part shows; k nodes."""

    nodes: Nodes  # where
    error_m: Float  # (k, 3) m, actual minus nominal tool tip, axes of the path; zero where nothing is believed
    sigma_m: Float  # (k, 3) m, standard deviations
    draws_m: Float  # (d, k, 3) m, draws from what is known, before anything was left out
    seen: Bool  # (k, 3) True where the part shows the component
    believed: Bool  # (k,) True on runs where an error is likelier than none
    noise_m: float  # standard deviation of a single place, from the data
    inflation: float  # factor of the variance of means, see noise
    log_evidence: float  # logarithm of the evidence with the error over that without it
    places: int  # places that the program made
    others: int  # places that it did not make
    outliers: float  # share of places beyond four standard deviations
    # share of the sum of squares of the deviations that the error explains, noise counted as unexplained
    explained: float
    prior: band_solver.Prior  # sizes and lengths found
    observed: band_solver.Observations  # the places as assigned to stretches
    place: Int  # (n,) their numbers in the part's rows


def path_error(part: PartDeviations, nodes: Nodes, contacts: Contacts, *, progress: Progress = silent) -> PathError:
    """Find the error of the path.

    ``part``: deviations, in the axes of the path.

    Raises:
        InputError: Too few places of the part were made by the program.
    """
    place = np.flatnonzero(contacts.made)
    machined = int(np.count_nonzero(part.face != FREE))
    least = max(_LEAST_PLACES, int(_LEAST_SHARE * machined))
    if np.count_nonzero(part.face[place] != FREE) < least:
        raise InputError(
            "the scan has too few places that this program made",
            value=f"{len(place)} of {machined} on floors and walls",
            limit=f"at least {least}",
            hint="Is it the scan of this program's part, in its part frame?",
        )
    stated = part.standard_deviation_m[place]
    usual = float(np.median(stated[stated > 0.0])) if np.any(stated > 0.0) else 20.0 * UM
    stated = np.maximum(stated, 0.2 * usual)
    y, rng = part.deviation_m[place], np.random.default_rng(_SEED)
    first = np.searchsorted(contacts.place, place)
    noise, inflation, weight = _start_noise(y, stated), 1.0, np.ones(len(y))
    low, high = np.quantile(y, (0.01, 0.99))
    size = max(float(np.sqrt(np.mean(np.clip(y, low, high) ** 2))), 5.0 * UM)
    prior = band_solver.Prior(size, 60.0 * MM, 0.5 * size, 5.0 * MM)
    d = np.zeros((len(nodes), 3))
    for turn in range(_ROUNDS):
        seen = _assigned(contacts, first, d, y, rng)
        for again in range(2):
            variance = (noise * stated) ** 2 * inflation / weight
            gathered = band_solver.Gathered.of(replace(seen, variance_m2=variance), band_solver.WIDTH * len(nodes))
            if again == 0 and turn in _SIZED:
                prior = _likeliest(nodes, prior, gathered)
            done = band_solver.solved(nodes, prior, gathered)
            residual = seen.y_m - seen.seen(done.mean)
            noise = max(1.4826 * float(np.median(np.abs(residual / stated))), 1e-3)
            weight = (_FREEDOM + 1.0) / (_FREEDOM + (residual / (noise * stated)) ** 2)
            weight /= float(np.mean(weight))
            inflation = variance_inflation(residual, noise * stated, part.points[place], part.face[place])
        d = band_solver.values_of(done.mean)
        progress((turn + 1.0) / _ROUNDS)
    seen = replace(seen, variance_m2=(noise * stated) ** 2 * inflation / weight)
    return _believed(seen, nodes, prior, done, part, place, noise * stated, inflation)


def _believed(
    seen: band_solver.Observations,
    nodes: Nodes,
    prior: band_solver.Prior,
    done: band_solver.BandSolution,
    part: PartDeviations,
    place: Int,
    scatter: Float,
    inflation: float,
) -> PathError:
    """Mark runs that are likelier with an error than without."""
    draws = band_solver.values_of(done.draws(_DRAWS, _SEED))
    sigma = np.hypot(np.std(draws, axis=0), _TIE_M)
    mean = band_solver.values_of(done.mean)
    residual = seen.y_m - seen.seen(done.mean)
    chain = nodes.chain[seen.node]
    gain = np.zeros(int(nodes.chain.max()) + 1)
    for number in range(len(gain)):
        own = chain == number
        if np.any(own):
            gain[number] = _gain(seen, own, nodes, prior)
    large = np.zeros(len(gain), dtype=np.bool_)
    np.logical_or.at(large, nodes.chain, np.any(np.abs(mean) > SIGMAS * sigma, axis=1))
    believed = ((gain > EVIDENCE) & large)[nodes.chain]
    r = residual / scatter
    return PathError(
        nodes=nodes,
        error_m=np.where(believed[:, None], mean, 0.0),
        sigma_m=sigma,
        draws_m=draws,
        seen=sigma < SEEN * prior.sigma_m(nodes.unrest)[:, None],
        believed=believed,
        noise_m=float(np.median(scatter)),
        inflation=inflation,
        log_evidence=float(np.sum(gain)),
        places=len(place),
        others=len(part) - len(place),
        outliers=float(np.mean(np.abs(r) > 4.0)),
        explained=1.0 - float(np.sum(residual**2) / max(np.sum(seen.y_m**2), 1e-30)),
        prior=prior,
        observed=seen,
        place=place,
    )


def _gain(seen: band_solver.Observations, own: Bool, nodes: Nodes, prior: band_solver.Prior) -> float:
    """Logarithm of the evidence of some observations with an error of the path over that without one."""
    some = band_solver.Observations(
        seen.node[own], seen.share[own], seen.normal[own], seen.y_m[own], seen.variance_m2[own]
    )
    gathered = band_solver.Gathered.of(some, band_solver.WIDTH * len(nodes))
    none = -0.5 * (gathered.square - gathered.log_weight + gathered.count * float(np.log(2.0 * np.pi)))
    return band_solver.solved(nodes, prior, gathered).log_evidence - none


def _start_noise(y: Float, stated: Float) -> float:
    """Noise over the stated one: from differences of places next to each other in the file, which may be far apart."""
    step = np.diff(y) / np.hypot(stated[1:], stated[:-1])
    return float(np.clip(1.4826 * np.median(np.abs(step)), 0.05, 20.0)) if len(step) else 1.0


def _assigned(contacts: Contacts, first: Int, d: Float, y: Float, rng: np.random.Generator) -> band_solver.Observations:
    """Each place with the stretch that leaves the least on it; ties are drawn (Gumbel), so that they are shared out."""
    begin = d[contacts.node - 1]
    own = begin + contacts.share[:, None] * (d[contacts.node] - begin)
    left = contacts.gap_m + np.sum(contacts.normal * own, axis=1)
    drawn = left - _TIE_M * rng.gumbel(size=len(left))
    group = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(left))))
    order = np.lexsort((drawn, group))
    pick = order[first]
    return band_solver.Observations(
        contacts.node[pick], contacts.share[pick], contacts.normal[pick], y - contacts.gap_m[pick], np.ones(len(y))
    )


def _likeliest(nodes: Nodes, prior: band_solver.Prior, gathered: band_solver.Gathered) -> band_solver.Prior:
    """Sizes and lengths with the largest evidence."""
    low = np.log([_SIGMA_M[0], band_solver.WIDE_M[0], _SIGMA_M[0], band_solver.NARROW_M[0]])
    high = np.log([_SIGMA_M[1], band_solver.WIDE_M[1], _SIGMA_M[1], band_solver.NARROW_M[1]])
    start = np.log([prior.wide_m, prior.wide_length_m, prior.narrow_m, prior.narrow_length_m])
    best = scipy.optimize.minimize(
        _improbability,
        np.clip(start, low, high),
        args=(low, high, nodes, gathered),
        method="Nelder-Mead",
        options={"maxfev": 70, "xatol": 0.05},
    )
    return band_solver.Prior(*np.exp(np.clip(best.x, low, high)).tolist())


def _improbability(x: Float, low: Float, high: Float, nodes: Nodes, gathered: band_solver.Gathered) -> float:
    """Negative logarithm of the evidence of a prior (logarithms x), which rises outside of its bounds."""
    beyond = float(np.sum(np.maximum(0.0, low - x) + np.maximum(0.0, x - high)))
    prior = band_solver.Prior(*np.exp(np.clip(x, low, high)).tolist())
    return -band_solver.solved(nodes, prior, gathered).log_evidence + 100.0 * beyond
