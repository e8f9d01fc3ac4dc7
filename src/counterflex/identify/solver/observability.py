"""Identifiability: rank, condition, and which parameters cannot be separated from which, in words.

Parameters without prior (frames, offsets of instruments) are first projected out of the weighted Jacobian; what is left
tells how much the data say about the others once those are free to follow. A *weak direction* is a combination of the
others that the data see less well than the priors know it (singular value below 1 in fit coordinates). The weak
directions are brought into echelon form, so that each names one parameter and what can stand in for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MM, PERCENT
from counterflex.identify.solver.fit import Seen
from counterflex.identify.solver.parameters import Parameter, Parameters

DETERMINED: Final = 0.5
"""Posterior by prior sigma below which the data determine a parameter."""
UNSEEN: Final = 0.9
"""Posterior by prior sigma above which they do not see it."""
_RANK = 1e-9
_PARTNER = 0.25
_BLIND = 1.0


@dataclass(frozen=True)
class Observability:
    """Result of :func:`examine`; see :class:`counterflex.identify.solver.fit.Fit`."""

    seen: tuple[Seen, ...]
    rank: int
    condition: float
    hidden: tuple[str, ...]


def examine(parameters: Parameters, free: Int, jacobian: Float, sigma_u: Float, prior: Bool) -> Observability:
    """Judge a weighted Jacobian in fit coordinates.

    Args:
        free: (f,) places of the free ones.
        jacobian: (m, f) of the weighted residuals, without priors.
        sigma_u: (f,) posterior standard deviations in fit coordinates.
        prior: (f,) which have a prior.
    """
    f = len(free)
    padded = np.concatenate([jacobian, np.zeros((max(f - len(jacobian), 0), f))])
    (R,) = scipy.linalg.qr(padded, mode="r", check_finite=False)
    R = R[:f]
    spectrum = np.linalg.svd(R, compute_uv=False)
    largest = float(spectrum[0]) if f else 0.0
    rank = int(np.sum(spectrum > largest * _RANK))
    condition = largest / float(spectrum[-1]) if f and spectrum[-1] > largest * 1e-300 else float("inf")
    seen: list[Seen] = ["held"] * len(parameters)
    for place, sigma in zip(free, sigma_u, strict=True):
        seen[place] = "determined" if sigma < DETERMINED else ("prior" if sigma > UNSEEN else "partly")
    items = [parameters.items[i] for i in free]
    return Observability(tuple(seen), rank, condition, _hidden(items, R, np.asarray(prior, dtype=np.bool_)))


def _hidden(items: Sequence[Parameter], R: Float, prior: Bool) -> tuple[str, ...]:
    loose, known = np.flatnonzero(~prior), np.flatnonzero(prior)
    reach = np.linalg.norm(R, axis=0)
    lost, leads = _lost_among(R[:, loose])
    directions = [(np.zeros(len(items)), int(loose[i])) for i in leads]
    for (direction, _), column in zip(directions, lost.T, strict=True):
        direction[loose] = column
    # What has no prior follows freely: a change that it takes up is not seen, however large its effect is by itself.
    follow = np.linalg.pinv(R[:, loose], rcond=_RANK) @ R[:, known] if len(loose) else np.zeros((0, len(known)))
    reduced = R[:, known] - R[:, loose] @ follow
    weak, leads = _weak(reduced)
    for column, i in zip(weak.T, leads, strict=True):
        direction = np.zeros(len(items))
        direction[known] = column
        direction[loose] = -follow @ column
        directions.append((direction, int(known[i])))
    blind, sentences = [], []
    for direction, lead in directions:
        partners = _partners(direction, lead, reach, bool(prior[lead]))
        outcome = "it keeps its former value" if prior[lead] else "not determined: its value has no meaning"
        if not partners:
            blind.append((_name(items[lead]), bool(prior[lead])))
        elif len(partners) == 1:
            other = partners[0]
            sentences.append(
                f"{_name(items[lead])} cannot be separated from {_name(items[other])}: "
                f"{_change(items[lead], direction[lead])} of one have the effect of "
                f"{_change(items[other], -direction[other])} of the other; {outcome}"
            )
        else:
            names = ", ".join(_name(items[i]) for i in partners[:-1]) + f" and {_name(items[partners[-1]])}"
            sentences.append(
                f"{_name(items[lead])} cannot be separated from {names}: only combinations are determined; {outcome}"
            )
    out = []
    for has_prior, text in ((True, "they keep their former values"), (False, "the values are not determined")):
        unseen = [name for name, known_before in blind if known_before == has_prior]
        if unseen:
            out.append(f"not determined by these measurements: {', '.join(unseen)} ({text})")
    return (*out, *sentences)


def _lost_among(R: Float) -> tuple[Float, Int]:
    """(l, d) directions among parameters without prior that the data do not see at all, in echelon form."""
    if R.shape[1] == 0:
        return np.zeros((0, 0)), np.zeros(0, dtype=np.int64)
    scale = np.linalg.norm(R, axis=0)
    scale[scale == 0.0] = 1.0
    _, s, vt = np.linalg.svd(R / scale, full_matrices=True)
    full = np.zeros(R.shape[1])
    full[: len(s)] = s
    return _echelon(vt[full <= max(float(full[0]), 1e-300) * _RANK].T / scale[:, None])


def _weak(R: Float) -> tuple[Float, Int]:
    """(k, d) directions in prior units that the data see less well than the priors, in echelon form."""
    if R.shape[1] == 0:
        return np.zeros((0, 0)), np.zeros(0, dtype=np.int64)
    _, s, vt = np.linalg.svd(R, full_matrices=True)
    full = np.zeros(R.shape[1])
    full[: len(s)] = s
    return _echelon(vt[full < _BLIND].T)


def _echelon(basis: Float) -> tuple[Float, Int]:
    """The same space (k, d) by columns with a leading entry 1 where all others have 0, and the places (d,) of these."""
    if basis.shape[1] == 0:
        return basis, np.zeros(0, dtype=np.int64)
    _, _, order = scipy.linalg.qr(basis.T, mode="economic", pivoting=True)
    lead = order[: basis.shape[1]].astype(np.int64)
    return basis @ np.linalg.inv(basis[lead]), lead


def _partners(direction: Float, lead: int, reach: Float, known: bool) -> list[int]:
    """Parameters that can replace the one that a direction is about, by their part in the measured values."""
    # None where the parameter itself moves nothing that could be seen.
    effect = np.abs(direction) * reach
    if effect[lead] < (_BLIND * abs(direction[lead]) if known else 0.0) or effect[lead] == 0.0:
        return []
    return [int(i) for i in np.argsort(-effect) if i != lead and effect[i] > _PARTNER * effect[lead]]


def _name(item: Parameter) -> str:
    return item.label or item.name


def _change(item: Parameter, coordinate: float) -> str:
    """A change of a fit coordinate in the unit of the shop."""
    size = coordinate * item.unit_step
    if item.log:
        return f"{size / PERCENT:.3g} %"
    factor, unit = {"m": (MM, "mm"), "rad": (DEG, "deg"), "1": (1.0, "")}.get(item.unit, (1.0, item.unit))
    return f"{size / factor:.3g} {unit}".rstrip()
