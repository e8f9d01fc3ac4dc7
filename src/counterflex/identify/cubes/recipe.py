"""Recipe ``cubes``: compliance of every elastic element from the relative motion of cubes on the structure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import in_parts
from counterflex.core.units import URAD
from counterflex.identify.counted_coverage import COUNTED
from counterflex.identify.cubes import TITLE
from counterflex.identify.cubes import proposal as cube_proposal
from counterflex.identify.cubes.pairs import SCALE, CubeMotions, block, read_cubes
from counterflex.identify.data.alternative_readings import row_mistakes, sign_mistakes, swapped_columns, unit_mistakes
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import Misfit, check_reading, misfit_of
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry import compliances
from counterflex.identify.geometry.compliances import DIRECTIONS, bearing_of, springs
from counterflex.identify.pulls import checks as pull_checks
from counterflex.identify.pulls.blocks import Layout, layout, with_honest_sigma
from counterflex.identify.recipe import Figure, Identification, Inputs, Proposal, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, cross_validate, score_separate
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import ElasticChain

SETTINGS: Final[Mapping[str, float | int | str | bool]] = {
    **compliances.SETTINGS,
    "prior": 1.0,
    "known": "sensor",
    "scale_sigma": SCALE,
    "folds": 5,
    "as_stated": False,
    **cube_proposal.SETTINGS,
}
"""Options: those of :mod:`.geometry.compliances` (with a wide prior, because cubes see single elements, and
the element ``sensor`` known from its data sheet where the cell has one of that name); ``scale_sigma``, how true the
sensors of a cube show its motion; ``folds``; ``as_stated``; and
those of :mod:`counterflex.identify.cubes.proposal`."""

_READING_ROWS: Final = 30  # rows that other readings of the data are tried on

CHECKING, FITTING, HELD_OUT = "checking the data", "fitting", "held out"
WORK: Final = {CHECKING: 0.07, FITTING: 0.31, HELD_OUT: 0.26}
"""Parts of the work with what they cost (processor time of two data sets, ``tools/measure_progress.py``)."""


def identify(inputs: Inputs) -> Identification:
    """Find compliances from cubes.

    ``inputs``: Geometry, compliances, masses, play; datasets of the kind ``cubes``, held out by loads.

    Returns:
        The identification; its headline is the share of held-out relative rotation that is not explained.

    Raises:
        InputError: Data that look wrong, or nothing to fit.
        FileFormatError: A channel or standard deviation is missing, or a pair names no bodies of the cell.
    """
    cell, data, holdout, settings, progress = inputs
    chain, options = cell.chain, cube_options(cell.chain, settings)
    parts = in_parts(progress, WORK)
    motions, unseen = ([read_cubes(chain, d) for d in some] for some in (data, holdout))
    plan = layout(chain, springs(chain, options), [m.pulls for m in [*motions, *unseen]], bearing_m=bearing_of(options))
    remarks: list[str] = []
    for i, d in enumerate([*data, *holdout]):
        pull_checks.check_plain(d)
        remarks += check_reading(
            d, _readings(d), _score(chain, plan), as_stated=bool(options["as_stated"]), rows=_READING_ROWS
        )
        parts[CHECKING]((i + 1) / (len(data) + len(holdout)))
    scale = _share(options["scale_sigma"])
    blocks = [block(chain, plan, m, scale) for m in motions]
    fit = solve(plan.parameters, blocks, progress=parts[FITTING])
    fit = with_honest_sigma(fit, blocks)
    parts[FITTING](1.0)
    holdout_progress = parts[HELD_OUT]
    if unseen:
        others = [block(chain, plan, m) for m in unseen]
        held_out, measured = (
            score_separate(plan.parameters, blocks, others, error=rotation_error, progress=holdout_progress),
            others,
        )
    else:
        folds = int(options["folds"])
        held_out, measured = (
            cross_validate(
                plan.parameters, blocks, error=rotation_error, folds=Folds(folds), progress=holdout_progress
            ),
            blocks,
        )
    holdout_progress(1.0)
    return Identification(
        recipe="cubes",
        fits={"cubes": fit},
        headline=_headline(held_out, [b.measured for b in measured]),
        figures=(Figure("motions", "relative motions used", float(sum(len(m.pair) for m in motions))),),
        changes=plan.springs.changes(chain, fit.values[: len(plan.springs)]),
        remarks=(*remarks, *_remarks(chain, plan, fit, motions)),
    )


def cube_options(chain: ElasticChain, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings, with the default of ``known`` empty where the cell has no element of that name."""
    options = {**SETTINGS, **settings}
    if options["known"] == SETTINGS["known"] not in chain.names:
        options["known"] = ""
    return options


def _share(value: object) -> float:
    if not (isinstance(value, int | float) and 0.0 <= float(value) <= 1.0):
        raise InputError("setting scale_sigma", value=str(value), limit="a relative standard deviation, 0 .. 1")
    return float(value)


def rotation_error(block: Residuals, x: Float) -> Float:
    """(n,) length of the error of each row's relative rotation, rad."""
    out: Float = np.linalg.norm((block.evaluate(x) * block.sigma)[:, 3:], axis=1)
    return out


def _headline(held_out: HeldOut, measured: Sequence[Float]) -> tuple[Figure, ...]:
    size = np.array([np.linalg.norm(measured[b][r, 3:]) for b, r in zip(held_out.block, held_out.row, strict=True)])
    keep = ~held_out.gross
    total = max(float(np.sum(size[keep])), 1e-300)
    share = [100.0 * float(np.sum(e[keep])) / total for e in (held_out.identified, held_out.nominal)]
    mean = [value / URAD for value in held_out.mean()]
    return (
        Figure(
            "holdout_unexplained_percent",
            "relative rotation of held-out cubes that is not explained: sum |measured - predicted| / sum |measured|",
            *share,
        ),
        Figure("holdout_mean_urad", "mean error of a held-out relative rotation", *mean),
    )


def _remarks(chain: ElasticChain, plan: Layout, fit: Fit, motions: Sequence[CubeMotions]) -> tuple[str, ...]:
    out = []
    for pair, first, last in sorted(
        {(m.pairs[p], int(m.first[i]), int(m.last[i])) for m in motions for i, p in enumerate(m.pair)}
    ):
        elastic = [chain.names[i] for i in range(first, last + 1) if np.any(plan.springs.segment == i)]
        if len(elastic) > 1:
            out.append(
                f"Between the cubes {pair} lie {' and '.join(elastic)}: the data determine only the sum of their "
                f"compliances, which is divided by the priors"
            )
    covered = {i for m in motions for a, b in zip(m.first, m.last, strict=True) for i in range(int(a), int(b) + 1)}
    missing = sorted({chain.names[int(i)] for i in plan.springs.segment if int(i) not in covered})
    if missing:
        out.append(f"No pair of cubes spans {', '.join(missing)}: their compliances stay as they were")
    weak = [
        f"{chain.names[s]}.{DIRECTIONS[d]}"
        for k, (s, d) in enumerate(zip(plan.springs.segment, plan.springs.direction, strict=True))
        if fit.seen[k] == "prior" and int(s) in covered
    ]
    if weak:
        out.append(f"The loads hardly turn {', '.join(weak)}: load them by a pure moment (bar and two cables)")
    return (*out, COUNTED["cubes"].text, *fit.hidden)


def _readings(data: Dataset) -> Any:
    load = "w_tcp_base" if data.has("w_tcp_base") else "f_tcp_base"
    moved = "d_after_base"
    return (
        *sign_mistakes(data, load, single=False),
        *unit_mistakes(data, load),
        *swapped_columns(data, load),
        *sign_mistakes(data, moved, single=False),
        *unit_mistakes(data, moved),
        *swapped_columns(data, moved),
        *unit_mistakes(data, "q"),
        *row_mistakes(moved),
    )


def _score(chain: ElasticChain, plan: Layout) -> Any:
    """Quick fit of one dataset, as :data:`counterflex.identify.data.manifest_checks.Score`."""

    def score(data: Dataset) -> Misfit:
        return misfit_of(solve(plan.parameters, [block(chain, plan, read_cubes(chain, data))]))

    return score


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses and loads; see :func:`counterflex.identify.cubes.proposal.propose_cubes`."""
    return cube_proposal.propose_cubes(cell, count, cube_options(cell.chain, settings))


RECIPE: Final = Recipe(
    "cubes",
    TITLE,
    ("cubes",),
    SETTINGS,
    identify,
    propose,
)
