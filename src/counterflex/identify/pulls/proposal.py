"""Choose pulls: poses and cable directions that make the predicted deflection of the tool certain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.units import DEG, UM
from counterflex.identify.data.model import CellModel
from counterflex.identify.design.choice import candidates_of, choose, expected_sigma, prior_information
from counterflex.identify.design.pose_candidates import measurable
from counterflex.identify.geometry.compliances import bearing_of, springs
from counterflex.identify.geometry.known_frames import known_frames
from counterflex.identify.pulls.blocks import PullLayout, block, layout
from counterflex.identify.pulls.pulls import AGAIN, HISTORIES, Pulls
from counterflex.identify.pulls.residuals import PullResiduals
from counterflex.identify.recipe import Proposal
from counterflex.robot.elasticity.chain import ElasticChain

DIRECTIONS: Final = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}
"""Base axes along which a cable pulls: over a pulley on four sides, and straight down with a weight."""
SETTINGS: Final[Mapping[str, float | int | str | bool]] = {
    "force_n": 750.0,
    "directions": "+x -x +y -y -z",
    "sigma_um": 10.0,
    "history": AGAIN,
    "instrument": "tracker",
    "seed": 0,
}
"""Options of the proposal: force of the cable, directions to choose from, standard deviation of a displacement, how
the loaded readings are taken, ``instrument`` that reads the displacement (``tracker`` or ``frame``, distance sensors
on a measuring frame), seed of the candidate poses."""
INSTRUMENTS: Final = ("tracker", "frame")
APPROACH_RAD: Final = -0.04 * DEG
"""From where every axis approaches its pose: far enough to turn all friction round, small enough to do at a creep."""
_LEAST: Final = 4
_OF_INSTRUMENT: Final = {
    "tracker": (),
    "frame": (
        "Read the distance sensors of the measuring frame before and under load (s_unloaded, s_loaded); put the frame "
        "up anew at each pose, square to the faces, and do not touch it between the two readings.",
    ),
}
_USE_POSES: Final = 60
_CANDIDATES: Final = 900
_SCALE_M: Final = 10.0 * UM


def propose_pulls(cell: CellModel, count: int, settings: Mapping[str, Any]) -> Proposal:
    """Choose pulls for the least variance of the deflection predicted near the part under forces in all directions.

    ``cell``: The cell; where it knows its tracker, poses are in its sight. ``settings``: See :data:`SETTINGS`, and
    those of :mod:`counterflex.identify.geometry.compliances`.

    Returns:
        Pulls in the order in which to take them: one cable direction after the other, each from pose to next pose.

    Raises:
        InputError: Too few, or a direction of length zero.
        ReachError: Hardly any pose can be measured.
    """
    options = {**SETTINGS, **settings}
    names = str(options["directions"]).replace(",", " ").split()
    force, sigma = float(options["force_n"]), float(options["sigma_um"]) * UM
    history, instrument = str(options["history"]), str(options["instrument"])
    _check_options(count, names, force, sigma, history, instrument)
    rng = np.random.default_rng(int(options["seed"]))
    chain, tracker = cell.chain, known_frames(cell)
    poses = min(max(3 * count, 60), _CANDIDATES // len(names))
    q = measurable(
        cell,
        poses,
        rng,
        tracker=None if tracker is None else tracker.T_base_tracker[:3, 3],
        p_tcp_target=None if tracker is None else tracker.T_tcp_target[:3, 3],
        around_part=0.4,
    )
    axes = np.array([DIRECTIONS[name] for name in names], dtype=np.float64)
    direction = np.tile(np.arange(len(names)), len(q))
    candidates = _pulls("candidates", np.repeat(q, len(names), axis=0), force * axes[direction], sigma, history)
    plan = layout(chain, springs(chain, options), [candidates], bearing_m=bearing_of(options))
    information = candidates_of(plan.parameters, [block(chain, plan, candidates, None)])
    chosen = choose(
        information.jacobian,
        min(count, len(candidates)),
        prior_information(plan.parameters),
        target=_use(cell, chain, plan, force, rng),
        passes=1,
    )
    order = _in_order(candidates.q, direction, chosen.indices)
    columns = {f"q{i + 1}_rad": candidates.q[order, i] for i in range(6)}
    columns |= {f"f{c}_n": candidates.w_tcp_base[order, i] for i, c in enumerate("xyz")}
    return Proposal(
        recipe="stiffness",
        kind="pulls",
        columns=columns,
        expected=expected_sigma(plan.parameters, chosen.covariance),
        units=plan.parameters.units,
        remarks=(*_remarks(names, direction[order], force, history), *_OF_INSTRUMENT[instrument]),
        settings={"history": history} | ({} if instrument == INSTRUMENTS[0] else {"instrument": instrument}),
    )


def _check_options(count: int, names: Sequence[str], force: float, sigma: float, history: str, instrument: str) -> None:
    wrong = [name for name in names if name not in DIRECTIONS]
    if wrong or not names:
        raise InputError("no such direction of a cable", value=" ".join(wrong), limit=" ".join(DIRECTIONS))
    if instrument not in INSTRUMENTS:
        raise InputError("setting instrument", value=instrument, limit=", ".join(INSTRUMENTS))
    if count < _LEAST or not force > 0.0 or not sigma > 0.0 or history not in HISTORIES:
        raise InputError(
            "cannot propose such pulls",
            value=f"{count} pulls of {force:g} N, {sigma / UM:g} um, {history}",
            limit=f"at least {_LEAST}, above 0 N and 0 um, {', '.join(HISTORIES)}",
        )


def _pulls(name: str, q: Float, force: Float, sigma: float, history: str) -> Pulls:
    n = len(q)
    none = np.zeros((n, 3))
    return Pulls(
        name=name,
        q=q,
        w_tcp_base=np.hstack([force, none]),
        w_sigma=np.zeros((n, 6)),
        d=none,
        d_sigma=np.full((n, 3), sigma),
        in_tracker=False,
        p_tcp_measured=np.zeros(3),
        approach=np.full((n, 6), APPROACH_RAD),
        history=history,
        group=np.arange(n, dtype=np.int64),
        line=np.arange(n, dtype=np.int64),
        where=name,
    )


def _use(cell: CellModel, chain: ElasticChain, plan: PullLayout, force: float, rng: np.random.Generator) -> Float:
    """(t, f) derivative of the deflection near the part by the fit coordinates, in units of 10 um."""
    q = measurable(cell, _USE_POSES, rng, around_part=1.0)
    axes = np.tile(np.eye(3), (len(q), 1))
    rows = _pulls("use", np.repeat(q, 3, axis=0), force * axes, _SCALE_M, "")
    use: PullResiduals = block(chain, plan, rows, None)
    free = np.flatnonzero(plan.parameters.free)
    x = plan.parameters.nominal
    J = use.jacobian(x)[:, :, free] * (use.sigma / _SCALE_M)[:, :, None] * plan.parameters.slope(x)[free]
    out: Float = J.reshape(-1, len(free)) / np.sqrt(len(J))
    return out


def _in_order(q: Float, direction: Int, chosen: Int) -> Int:
    """One direction after the other; within each from pose to nearest pose."""
    out: list[int] = []
    for d in np.unique(direction[chosen]):
        remaining = [int(i) for i in chosen if direction[i] == d]
        at = q[out[-1]] if out else q[remaining[0]]
        while remaining:
            near = remaining[int(np.argmin(np.abs(q[remaining] - at).max(axis=1)))]
            remaining.remove(near)
            out.append(near)
            at = q[near]
    return np.array(out, dtype=np.int64)


def _remarks(names: list[str], direction: Int, force: float, history: str) -> tuple[str, ...]:
    counts = ", ".join(f"{int(np.sum(direction == i))} in {name}" for i, name in enumerate(names))
    how = {
        AGAIN: "Read the target, apply the load, move every axis back by about 0.04 deg and return slowly, read "
        "again: friction is then the same in both readings.",
        "held": "Hold all axes still while the load comes on, slowly, and between the readings.",
        "relaxed": "Before each reading let all axes swing by some 0.1 deg, dying away, so that friction lets go.",
    }[history]
    return (
        f"Pull with {force:g} N along the base axes at the tool tip ({counts}); weigh the load or use a load cell.",
        "Approach every pose by moving all axes in the positive direction over the last 0.04 deg.",
        how,
    )
