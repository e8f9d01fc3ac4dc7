"""Which poses and loads to take with measuring cubes on the structure."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, UM
from counterflex.identify.cubes.pairs import BASE, CubeMotions, block
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import candidates_of, choose, expected_sigma, prior_information
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.geometry.compliances import bearing_of, springs
from counterflex.identify.pulls.blocks import layout
from counterflex.identify.pulls.proposal import APPROACH_RAD
from counterflex.identify.pulls.pulls import AGAIN, HISTORIES, Pulls
from counterflex.identify.recipe import Proposal
from counterflex.robot.elasticity.chain import ElasticChain, frames

SETTINGS: Final[Mapping[str, float | int | str | bool]] = {
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

    ``settings``: See :data:`SETTINGS`, and those of :mod:`counterflex.identify.geometry.compliances`.

    Raises:
        InputError: No load, no sensor noise, or no such history.
        ReachError: Hardly any pose can be measured.
    """
    options = {**SETTINGS, **settings}
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
