"""Recipe ``stiffness``: compliance of every elastic element from the displacement of the tool under known loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import Progress, silent
from counterflex.core.units import MM, UM
from counterflex.identify import compliances, pull_proposal
from counterflex.identify.compliances import springs
from counterflex.identify.dataset import Dataset
from counterflex.identify.fit import Fit
from counterflex.identify.holdout import HeldOut, cross_validate, position_error, score_separate
from counterflex.identify.known_frames import KnownFrames, known_frames
from counterflex.identify.model import CellModel
from counterflex.identify.pull_blocks import Layout, block, layout, refreshed
from counterflex.identify.pull_proposal import propose_pulls
from counterflex.identify.pull_residuals import PullResiduals
from counterflex.identify.pulls import Pulls, read_pulls
from counterflex.identify.recipe import Figure, Identification, Proposal, Recipe
from counterflex.identify.solve import solve
from counterflex.robot.chain import ElasticChain

_SETTLED_M: Final = 1.0 * UM
_ROUNDS: Final = 5


def identify(
    cell: CellModel,
    data: Sequence[Dataset],
    holdout: Sequence[Dataset],
    settings: Mapping[str, Any],
    progress: Progress = silent,
) -> Identification:
    """Compliances from pulls; see :data:`counterflex.identify.recipe.Identify`."""
    options = {**SETTINGS, **settings}
    chain = cell.chain
    if not data:
        raise InputError("stiffness needs at least one dataset of pulls")
    tracker = _frames(cell, [*data, *holdout])
    R_base_tracker = None if tracker is None else tracker.T_base_tracker[:3, :3]
    target = None if tracker is None else tracker.T_tcp_target[:3, 3]
    pulls = [read_pulls(chain, d, target) for d in data]
    unseen = [read_pulls(chain, d, target) for d in holdout]
    turn_sigma = None if tracker is None or tracker.sigma is None else tracker.sigma[3:]
    plan = layout(chain, springs(chain, options), [*pulls, *unseen], turn_sigma)
    fit, blocks = settle(chain, plan, pulls, [block(chain, plan, p, R_base_tracker) for p in pulls], progress)
    if unseen:
        others = [refreshed(block(chain, plan, p, R_base_tracker), chain, plan, p, fit.values) for p in unseen]
        held = score_separate(plan.parameters, blocks, others, needed=plan.frame_names, error=position_error)
        measured = [b.measured for b in others]
    else:
        held = cross_validate(plan.parameters, blocks, needed=plan.frame_names, error=position_error)
        measured = [b.measured for b in blocks]
    return Identification(
        recipe="stiffness",
        fits={"stiffness": fit},
        headline=headline(held, measured),
        figures=(),
        changes=plan.springs.changes(chain, fit.values[: len(plan.springs)]),
        remarks=tuple(fit.hidden),
    )


def settle(
    chain: ElasticChain, plan: Layout, pulls: Sequence[Pulls], blocks: Sequence[PullResiduals], progress: Progress
) -> tuple[Fit, list[PullResiduals]]:
    """Fit, with what is not linear in the compliances brought up to date until it rests within 1 um."""
    now = list(blocks)
    for _ in range(_ROUNDS):
        fit = solve(plan.parameters, now, progress=progress)
        new = [refreshed(b, chain, plan, p, fit.values) for b, p in zip(now, pulls, strict=True)]
        change = max(
            float(np.max(np.abs(a.offset - b.offset)[:, :3], initial=0.0)) for a, b in zip(now, new, strict=True)
        )
        now = new
        if change < _SETTLED_M:
            break
    return fit, now


def headline(held: HeldOut, measured: Sequence[Float]) -> tuple[Figure, ...]:
    """Error of held-out pulls: in all, at worst, and in the median."""
    size = np.array([np.linalg.norm(measured[b][r, :3]) for b, r in zip(held.block, held.row, strict=True)])
    keep = ~held.gross
    total = float(np.sum(size[keep]))
    errors = {"identified": held.identified[keep], "nominal": held.nominal[keep]}
    share = {key: 100.0 * float(np.sum(e)) / total for key, e in errors.items()}
    worst = {key: float(np.max(e)) / MM for key, e in errors.items()}
    median = {key: 100.0 * float(np.median(e / size[keep])) for key, e in errors.items()}
    return (
        Figure(
            "holdout_unexplained_percent",
            "deflection of held-out pulls that the model does not explain, sum |measured - predicted| / sum |measured|",
            share["identified"],
            share["nominal"],
        ),
        Figure(
            "holdout_explained_percent",
            "deflection of held-out pulls explained",
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


def _frames(cell: CellModel, data: Sequence[Dataset]) -> KnownFrames | None:
    """The tracker, where displacements are written in its axes."""
    if all(d.has("d_tcp_base") for d in data):
        return None
    known = known_frames(cell)
    if known is None:
        raise InputError(
            "the cell does not say how the tracker stands, in whose axes the displacements are written",
            where=next(d.where for d in data if not d.has("d_tcp_base")),
            hint="Run the recipe tracker-frame or kinematics first, or give displacements in base axes (d_tcp_base)",
        )
    return known


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses and loads; see :data:`counterflex.identify.recipe.Propose`."""
    return propose_pulls(cell, count, {**SETTINGS, **settings})


SETTINGS: Final[Mapping[str, float | int | str | bool]] = {**compliances.SETTINGS, **pull_proposal.SETTINGS}
RECIPE: Final = Recipe(
    "stiffness",
    "compliance of axes, links, sensor and holder from pulls at the tool",
    ("pulls",),
    SETTINGS,
    identify,
    propose,
)
