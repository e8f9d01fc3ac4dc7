"""Recipe ``stiffness``: compliance of every elastic element from the displacement of the tool under known loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, in_parts, saying, share_of
from counterflex.core.units import UM
from counterflex.identify.data.changes import ElementRegion
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import Misfit, check_reading, misfit_of
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry import compliances
from counterflex.identify.geometry.compliances import bearing_of, springs, with_compliance
from counterflex.identify.geometry.known_frames import KnownFrames, known_frames
from counterflex.identify.pulls import checks as pull_checks, proposal as pull_proposal
from counterflex.identify.pulls.blocks import PullLayout, block, layout, refreshed, with_honest_sigma
from counterflex.identify.pulls.proposal import propose_pulls
from counterflex.identify.pulls.pulls import Pulls, read_pulls
from counterflex.identify.pulls.residuals import PullResiduals
from counterflex.identify.recipe import Identification, Inputs, Proposal, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, cross_validate, position_error, score_separate
from counterflex.identify.solver.solve import solve
from counterflex.identify.stiffness import TITLE, piecewise_compliance, report as pull_report
from counterflex.identify.stiffness.frame_pulls import with_displacements
from counterflex.robot.elasticity.chain import ElasticChain

SETTINGS: Final[Mapping[str, float | int | str | bool]] = {
    **compliances.SETTINGS,
    "regions": True,
    "folds": 5,
    "as_stated": False,
    **pull_proposal.SETTINGS,
}
"""Options: those of :mod:`.geometry.compliances`; ``regions``, whether compliances may change with angle and
load where the data demand it; ``folds`` of the hold-out; ``as_stated``, data that look wrong are used all the same; and
those of :mod:`counterflex.identify.pulls.proposal`."""
_SETTLED_M: Final = 1.0 * UM
_ROUNDS: Final = 5
CHECKING, COMPLIANCES, REGIONS, HELD_OUT = "checking the data", "compliances", "regions of stiffness", "held out"
WORK: Final = {CHECKING: 0.07, COMPLIANCES: 0.15, REGIONS: 0.2, HELD_OUT: 0.16}
"""Parts of the work with what they cost (processor time of two data sets, ``tools/measure_progress.py``)."""


def identify(inputs: Inputs) -> Identification:
    """Find compliances from pulls.

    ``inputs``: Geometry, compliances, masses, play, and the tracker where displacements are in its axes; ``pulls``.

    Returns:
        The identification; its headline is the share of held-out deflection that is not explained.

    Raises:
        InputError: Data that look wrong (negative work, other units, signs, columns or axes), or nothing to fit.
        FileFormatError: A channel or standard deviation is missing.
    """
    cell, data, holdout, options, progress = inputs
    parts = in_parts(progress, WORK)
    chain, stated = cell.chain, bool(options["as_stated"])
    data, notes = _moved(chain, data, as_stated=stated)
    holdout, of_holdout = _moved(chain, holdout, as_stated=stated)
    notes += of_holdout
    tracker = _frames(cell, [*data, *holdout])
    for d in [*data, *holdout]:
        pull_checks.check_plain(d)
    everything = [_read(chain, d, tracker) for d in [*data, *holdout]]
    plan = layout(chain, springs(chain, options), everything, _turn(tracker), bearing_m=bearing_of(options))
    for i, (d, p) in enumerate(zip([*data, *holdout], everything, strict=True)):
        pull_checks.check_work(chain, p, _axes(tracker), as_stated=stated, most=pull_checks.ALL_BUT)
        notes += check_reading(d, pull_checks.readings(chain, d), _score(chain, plan, tracker), as_stated=stated)
        notes += pull_checks.check_work(chain, p, _axes(tracker), as_stated=stated)
        parts[CHECKING]((i + 1) / len(everything))
    pulls, unseen = everything[: len(data)], everything[len(data) :]
    blocks = [block(chain, plan, p, _axes(tracker)) for p in pulls]
    fit, blocks = settle(chain, plan, pulls, blocks, saying(parts[COMPLIANCES], COMPLIANCES))
    parts[COMPLIANCES](1.0)
    pieces = (
        piecewise_compliance.search(chain, plan, pulls, blocks, fit, parts[REGIONS]) if options["regions"] else None
    )
    parameters = plan.parameters
    if pieces is not None and pieces.regions:
        parameters, blocks = pieces.parameters, list(pieces.blocks)
        fit = solve(parameters, blocks)
    fit = with_honest_sigma(fit, blocks)
    parts[REGIONS](1.0)
    folds = int(options["folds"])
    held_out, measured = _judged(chain, plan, pieces, fit, blocks, unseen, _axes(tracker), folds, parts[HELD_OUT])
    parts[HELD_OUT](1.0)
    headline = pull_report.headline(held_out, measured)
    if not stated:
        pull_checks.check_worth(headline[0].value, data[0].where or data[0].name)
    values = fit.values[: len(plan.springs)]
    elements = piecewise_compliance.elements(pieces, chain, plan, fit)
    after = with_compliance(chain, plan.springs.compliance(chain, values))
    return Identification(
        recipe="stiffness",
        fits={"stiffness": fit},
        headline=headline,
        figures=pull_report.figures(after, pulls, fit, held_out),
        changes=(*plan.springs.changes(chain, values), *(ElementRegion(r) for r in elements)),
        remarks=(*notes, *pull_report.remarks(chain, plan, fit, held_out, pulls, pieces)),
        pictures=pull_report.pictures(held_out, measured, plan, fit),
    )


def _moved(chain: ElasticChain, data: Sequence[Dataset], *, as_stated: bool) -> tuple[list[Dataset], list[str]]:
    """Datasets with displacements, also those of measuring frames, and what is to be said about these."""
    displaced = [with_displacements(chain, d, as_stated=as_stated) for d in data]
    return [d for d, _ in displaced], [text for _, remarks in displaced for text in remarks]


def settle(
    chain: ElasticChain, plan: PullLayout, pulls: Sequence[Pulls], blocks: Sequence[PullResiduals], progress: Progress
) -> tuple[Fit, list[PullResiduals]]:
    """Fit, with what is not linear in the compliances brought up to date until it rests within 1 um.

    Returns the fit, and the blocks with their offsets at its values.
    """
    now = list(blocks)
    fit = solve(plan.parameters, now, progress=share_of(progress, 0.0, 0.5))
    for turn in range(_ROUNDS):
        new = [refreshed(b, chain, plan, p, fit.values) for b, p in zip(now, pulls, strict=True)]
        change = max(
            float(np.max(np.abs(a.offset - b.offset)[:, :3], initial=0.0)) for a, b in zip(now, new, strict=True)
        )
        now = new
        round_progress = share_of(progress, 1.0 - 0.5 ** (turn + 1), 1.0 - 0.5 ** (turn + 2))
        fit = solve(plan.parameters, now, start=fit.values, progress=round_progress)
        if change < _SETTLED_M:
            break
    return fit, now


def _judged(
    chain: ElasticChain,
    plan: PullLayout,
    pieces: piecewise_compliance.PiecewiseSearch | None,
    fit: Fit,
    blocks: Sequence[PullResiduals],
    unseen: Sequence[Pulls],
    R_base_tracker: Float | None,
    folds: int,
    progress: Progress,
) -> tuple[HeldOut, list[Float]]:
    """Errors on data not used, and the displacements they are errors of."""
    parameters = plan.parameters if pieces is None else pieces.parameters
    if not unseen:
        held_out = cross_validate(
            parameters, blocks, needed=plan.frame_names, error=position_error, folds=Folds(folds), progress=progress
        )
        return held_out, [b.measured for b in blocks]
    others = [refreshed(block(chain, plan, p, R_base_tracker), chain, plan, p, fit.values) for p in unseen]
    if pieces is not None and pieces.regions:
        others = [pieces.shaped_like(chain, plan, p, b) for p, b in zip(unseen, others, strict=True)]
    held_out = score_separate(
        parameters, blocks, others, needed=plan.frame_names, error=position_error, progress=progress
    )
    return held_out, [b.measured for b in others]


def _score(chain: ElasticChain, plan: PullLayout, tracker: KnownFrames | None) -> Any:
    """Quick fit of one dataset, as :data:`counterflex.identify.data.manifest_checks.Score`."""

    def score(data: Dataset) -> Misfit:
        pulls = _read(chain, data, tracker)
        return misfit_of(solve(plan.parameters, [block(chain, plan, replace(pulls, history=""), _axes(tracker))]))

    return score


def _read(chain: ElasticChain, data: Dataset, tracker: KnownFrames | None) -> Pulls:
    return read_pulls(chain, data, None if tracker is None else tracker.T_tcp_target[:3, 3])


def _axes(tracker: KnownFrames | None) -> Float | None:
    return None if tracker is None else tracker.T_base_tracker[:3, :3]


def _turn(tracker: KnownFrames | None) -> Float | None:
    return None if tracker is None or tracker.sigma is None else tracker.sigma[3:]


def _frames(cell: CellModel, data: Sequence[Dataset]) -> KnownFrames | None:
    """The tracker, where displacements are written in its axes."""
    if all(d.has("d_tcp_base") or not d.has("d_tracker_target") for d in data):
        return None
    known = known_frames(cell)
    if known is None:
        raise InputError(
            "the cell file has no orientation of the tracker, in whose axes the displacements are given",
            where=next(d.where for d in data if not d.has("d_tcp_base")),
            hint="Run the recipe tracker-frame or kinematics first, or give displacements in base axes (d_tcp_base)",
        )
    return known


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses and loads; see :func:`counterflex.identify.pulls.proposal.propose_pulls`."""
    return propose_pulls(cell, count, {**SETTINGS, **settings})


RECIPE: Final = Recipe("stiffness", TITLE, ("pulls",), SETTINGS, identify, propose)
