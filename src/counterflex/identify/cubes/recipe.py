"""Recipe ``cubes``: compliance of every elastic element from the relative motion of cubes on the structure."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.progress import in_parts
from counterflex.core.units import MM, UM, URAD
from counterflex.identify.counted_coverage import COUNTED
from counterflex.identify.cubes import TITLE
from counterflex.identify.cubes.pairs import BASE, SCALE, CubeMotions, block, read_cubes
from counterflex.identify.data.alternative_readings import row_mistakes, sign_mistakes, swapped_columns, unit_mistakes
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.manifest_checks import Misfit, check_reading, misfit_of
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import candidates_of, choose, expected_sigma, prior_information
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.geometry import compliances
from counterflex.identify.geometry.compliances import DIRECTIONS, bearing_of, springs
from counterflex.identify.pulls import checks as pull_checks
from counterflex.identify.pulls.blocks import PullLayout, layout, with_honest_sigma
from counterflex.identify.pulls.proposal import APPROACH_RAD
from counterflex.identify.pulls.pulls import AGAIN, HISTORIES, Pulls
from counterflex.identify.recipe import Figure, Identification, Inputs, Proposal, Recipe
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.holdout import Folds, HeldOut, cross_validate, score_separate
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import solve
from counterflex.robot.elasticity.chain import ElasticChain, frames

PROPOSED: Final[Mapping[str, float | int | str | bool]] = {
    "force_n": 750.0,
    "moment_nm": 300.0,
    "sensor_um": 0.3,
    "history": AGAIN,
    "seed": 0,
}
"""Options of the proposal: cable force, pure moment by a bar and two cables (0 for none), standard deviation of an
averaged triangulation sensor, how loaded readings are taken, seed of the candidate poses."""
_BASELINE_M: Final = 70.0 * MM
_POSES: Final = 24
_FORCES = ((1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, -1))


def pairs_of(chain: ElasticChain) -> tuple[str, ...]:
    """Every elastic or driven body against the one before: ``base/axis1``, ``axis1/axis2``, ..."""
    names = [BASE] + [
        name for i, name in enumerate(chain.names) if chain.joint[i] >= 0 or np.any(chain.compliance[i] > 0.0)
    ]
    return tuple(f"{a}/{b}" for a, b in itertools.pairwise(names))


def propose_cubes(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Choose poses and loads for the least determinant of the covariance; all pairs are read under each load.

    ``settings``: See :data:`PROPOSED`, and those of :mod:`counterflex.identify.geometry.compliances`. Raises
    InputError: no load, no sensor noise, or no such history. Raises ReachError: hardly any pose can be measured.
    """
    options = {**PROPOSED, **settings}
    force, moment, history = float(options["force_n"]), float(options["moment_nm"]), str(options["history"])
    sigma = float(options["sensor_um"]) * UM
    if count < 1 or not force > 0.0 or moment < 0.0 or not sigma > 0.0 or history not in HISTORIES:
        raise InputError(
            "cannot propose such loads",
            value=f"{count} loads of {force:g} N, {moment:g} N m, {history}",
            limit=f"at least 1, above 0 N, {', '.join(HISTORIES)}",
        )
    chain = cell.chain
    rng = np.random.default_rng(int(options["seed"]))
    q = measurable(cell, max(_POSES, count), rng, around_part=0.3)
    none = np.zeros(3)
    kinds = [np.concatenate([force * np.array(f, dtype=np.float64), none]) for f in _FORCES]
    if moment > 0.0:
        kinds += [np.concatenate([none, moment * axis]) for axis in np.eye(3)]
    load = np.tile(np.array(kinds), (len(q), 1))
    poses = np.repeat(q, len(kinds), axis=0)
    motions = _motions(chain, poses, load, sigma, history)
    plan = layout(chain, springs(chain, options), [], bearing_m=bearing_of(options))
    information = candidates_of(plan.parameters, [block(chain, plan, motions)])
    chosen = choose(information.jacobian, min(count, len(poses)), prior_information(plan.parameters), passes=1)
    order = np.sort(chosen.indices)
    columns = {f"q{i + 1}_rad": poses[order, i] for i in range(6)}
    columns |= {f"f{c}_n": load[order, i] for i, c in enumerate("xyz")}
    columns |= {f"m{c}_nm": load[order, 3 + i] for i, c in enumerate("xyz")}
    return Proposal(
        recipe="cubes",
        kind="cubes",
        columns=columns,
        expected=expected_sigma(plan.parameters, chosen.covariance),
        units=plan.parameters.units,
        remarks=(
            f"Fix a cube on each of {', '.join(pairs_of(chain))} and measure where it sits with the tracker.",
            "Read six triangulation sensors at each cube before and under every load; average their readings.",
            f"Force by a cable over a pulley and a weight ({force:g} N); moment by a bar and two cables "
            f"({moment:g} N m).",
        ),
        settings={"pairs": list(pairs_of(chain)), "history": history},
    )


def _motions(chain: ElasticChain, q: Float, load: Float, sigma: float, history: str) -> CubeMotions:
    """All pairs under every load; cubes at the frames of their bodies."""
    pairs = pairs_of(chain)
    n, k = len(q), len(pairs)
    row, pair = np.repeat(np.arange(n), k), np.tile(np.arange(k), n)
    known = (BASE, *chain.names)
    ends = np.array([[known.index(name) for name in p.split("/")] for p in pairs])
    Ts = frames(chain, q)
    centre = Ts[row, ends[pair, 1] - 1, :3, 3]
    noise = np.array([1.0] * 3 + [np.sqrt(2.0) / _BASELINE_M] * 3) * 2.0 * sigma
    pulls = Pulls(
        name="candidates",
        q=q[row],
        w_tcp_base=load[row],
        w_sigma=np.zeros((n * k, 6)),
        d=np.zeros((n * k, 6)),
        d_sigma=np.tile(noise, (n * k, 1)),
        in_tracker=False,
        p_tcp_measured=np.zeros(3),
        approach=np.full((n * k, 6), APPROACH_RAD),
        history=history,
        group=row.astype(np.int64),
        line=row.astype(np.int64),
        where="candidates",
    )
    none = np.zeros((len(pulls), 6))
    return CubeMotions(pulls, ends[pair, 0], ends[pair, 1] - 1, centre, pairs, pair.astype(np.int64), none, none)


SETTINGS: Final[Mapping[str, float | int | str | bool]] = {
    **compliances.SETTINGS,
    "prior": 1.0,
    "known": "sensor",
    "scale_sigma": SCALE,
    "folds": 5,
    "as_stated": False,
    **PROPOSED,
}
"""Options: those of :mod:`.geometry.compliances` (with a wide prior, because cubes see single elements, and
the element ``sensor`` known from its data sheet where the cell has one of that name); ``scale_sigma``, how true the
sensors of a cube show its motion; ``folds``; ``as_stated``; and
those of :data:`PROPOSED`."""

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


def _remarks(chain: ElasticChain, plan: PullLayout, fit: Fit, motions: Sequence[CubeMotions]) -> tuple[str, ...]:
    out = []
    spans = sorted({(m.pairs[p], int(m.first[i]), int(m.last[i])) for m in motions for i, p in enumerate(m.pair)})
    soft = set(plan.springs.segment.tolist())
    for pair, first, last in spans:
        elastic = [chain.names[i] for i in sorted(soft & set(range(first, last + 1)))]
        if len(elastic) > 1:
            out.append(
                f"Between the cubes {pair} lie {' and '.join(elastic)}: the data determine only the sum of their "
                f"compliances, which is divided by the priors"
            )
    covered = {i for _, first, last in spans for i in range(first, last + 1)}
    missing = sorted(chain.names[i] for i in soft - covered)
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


def _score(chain: ElasticChain, plan: PullLayout) -> Any:
    """Quick fit of one dataset, as :data:`counterflex.identify.data.manifest_checks.Score`."""

    def score(data: Dataset) -> Misfit:
        return misfit_of(solve(plan.parameters, [block(chain, plan, read_cubes(chain, data))]))

    return score


def propose(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Poses and loads; see :func:`propose_cubes`."""
    return propose_cubes(cell, count, cube_options(cell.chain, settings))


RECIPE: Final = Recipe("cubes", TITLE, ("cubes",), SETTINGS, identify, propose)
