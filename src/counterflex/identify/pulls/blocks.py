"""From pulls to residuals: which parameters they have, what they predict beyond the springs, how uncertain they are."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MM
from counterflex.identify.geometry.compliances import Springs, with_compliance
from counterflex.identify.pulls.history import band_slopes, lost_angles, lost_sigma
from counterflex.identify.pulls.pulls import Pulls
from counterflex.identify.pulls.residuals import COMPONENTS, PullResiduals, carried, gains, misplaced, misplaced_by
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import added, considered, parts_of_groups, with_jackknife
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.elasticity.compliance import cartesian_compliance, element_jacobians, linear_gap

# Directions of an elastic element that move each other: what a diagonal compliance leaves out, the same in all poses.
# A housing or a bearing under a moment about one of its axes also turns a little about the others. An element of this
# model has six compliances and no coupling between them. Coupling is the same in every pull, so it passes for another
# compliance, and neither residuals nor pulls left out show it. It goes through the fit with its usual size
# (:mod:`counterflex.identify.solver.jackknife`).

COUPLING: Final = 0.1
"""Compliance between two directions of an element over the root of the product of theirs, one standard deviation."""


def coupled_by(
    chain: ElasticChain,
    springs: Springs,
    q: Float,
    w_tcp_base: Float,
    at: Callable[[Float], Float],
    acts: Bool | None = None,
) -> Float:
    """Displacements of the tool by one standard deviation of each coupling.

    ``d = k sqrt(c_a c_b) (J_a (J_b^T w) + J_b (J_a^T w))`` for each two directions a, b of an element, k
    :data:`COUPLING`.

    Args:
        chain: The cell's.
        q: (n, 6) rad.
        w_tcp_base: (n, 6) N, N m.
        at: Takes twists (n, 6, m) given at the TCP to the point whose displacement is wanted.
        acts: (n, k) whether a spring lies between what is compared in a row; None is all.

    Returns:
        (n, 6, m) m, rad, base axes: a column for each two directions of one element.
    """
    J = element_jacobians(chain, q)  # (n, s, 6, 6)
    soft = springs.of_chain(chain)
    out = []
    for a, b in itertools.combinations(range(len(springs)), 2):
        if springs.segment[a] != springs.segment[b] or soft[a] * soft[b] == 0.0:
            continue
        Ja, Jb = (J[:, springs.segment[k], :, springs.direction[k]] for k in (a, b))
        moved = Ja * np.sum(Jb * w_tcp_base, axis=1)[:, None] + Jb * np.sum(Ja * w_tcp_base, axis=1)[:, None]
        if acts is not None:
            moved = moved * acts[:, a, None]
        out.append(COUPLING * np.sqrt(soft[a] * soft[b]) * moved)
    return at(np.stack(out, axis=2)) if out else np.zeros((len(q), 6, 0))


BEARING_M: Final = 10.0 * MM
"""How well the centre is known that an elastic element turns about, per axis."""
BAND_PRIOR: Final = 0.5
"""Relative prior standard deviation of the half band of an axis' play."""
TURN_PRIOR_RAD: Final = 2.0 * DEG
"""How well the axes of a tracker are known where no registration says it."""


@dataclass(frozen=True, eq=False)
class PullLayout:
    """Parameters of a stiffness identification: springs, half bands of the play, turn of the tracker."""

    springs: Springs  # of the cell
    parameters: Parameters  # all of them; the springs first
    bands: Int  # (6,) places of the half bands, -1 where not fitted
    turn: Int | None  # (3,) places of the turn of the tracker's axes, or None
    bearing_m: float  # how well the points are known that the elements turn about, per axis

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Parameters that any use of the data has to find first."""
        return () if self.turn is None else tuple(self.parameters.names[i] for i in self.turn)


def layout(
    chain: ElasticChain,
    springs: Springs,
    pulls: Sequence[Pulls],
    turn_sigma: Float | None = None,
    *,
    bearing_m: float = BEARING_M,
) -> PullLayout:
    """Parameters for some pulls.

    Half bands are parameters where a history is known (elsewhere play only adds to the standard deviation); the turn
    of the tracker where displacements are written in its axes.

    ``turn_sigma``: (3,) rad, prior standard deviation of the tracker's axes; None is :data:`TURN_PRIOR_RAD`.
    """
    items: list[Parameter] = []
    bands = np.full(6, -1, dtype=np.int64)
    if chain.play is not None and any(p.history for p in pulls):
        for axis, entry in enumerate(chain.play):
            if entry is not None and entry.half_band_rad > 0.0:
                bands[axis] = len(springs) + len(items)
                b = entry.half_band_rad
                items.append(
                    Parameter(
                        f"axis{axis + 1}.half_band",
                        "rad",
                        b,
                        BAND_PRIOR * b,
                        lower=0.0,
                        upper=20.0 * b,
                        label=f"play of axis {axis + 1}",
                    )
                )
    turn = None
    if any(p.in_tracker for p in pulls):
        first = len(springs) + len(items)
        turn = np.arange(first, first + 3, dtype=np.int64)
        items += [
            Parameter(f"T_base_tracker.r{c}", "rad", 0.0, float(s), label=f"turn of the tracker about its {c}")
            for c, s in zip("xyz", np.full(3, TURN_PRIOR_RAD) if turn_sigma is None else turn_sigma, strict=True)
        ]
    return PullLayout(springs, springs.parameters + Parameters.of(items), bands, turn, bearing_m)


def block(chain: ElasticChain, plan: PullLayout, pulls: Pulls, R_base_tracker: Float | None) -> PullResiduals:
    """Residuals of pulls around what the cell file says.

    Standard deviations: of the displacement as stated, of the load times the compliance of the arm, of the lost motion
    (:func:`counterflex.identify.pulls.history.lost_sigma`), and of bearings that are not where they are thought to be
    (:func:`counterflex.identify.pulls.residuals.misplaced`).

    ``R_base_tracker``: (3, 3) axes of the tracker in the base; needed where ``pulls.in_tracker``. Returns the block;
    :func:`refreshed` brings its offset up to date.
    """
    c = pulls.d.shape[1]
    point = pulls.p_tcp_measured
    gain = gains(chain, plan.springs, pulls.q, pulls.w_tcp_base, point)[:, :c]
    variance = np.zeros((len(pulls), 6))
    if np.any(pulls.w_sigma > 0.0):
        variance += (_compliance_at(chain, pulls) ** 2 @ (pulls.w_sigma**2)[:, :, None])[..., 0]
    # Friction is no parameter here: what is doubted of it widens the rows.
    variance += lost_sigma(chain, pulls) ** 2
    variance += misplaced(chain, plan.springs, pulls.q, pulls.w_tcp_base, point, plan.bearing_m) ** 2
    added = variance[:, :c]
    at = partial(carried, chain, pulls.q, p_tcp_point=point)
    aside = misplaced_by(chain, plan.springs, pulls.q, pulls.w_tcp_base, plan.bearing_m, at)
    coupled = coupled_by(chain, plan.springs, pulls.q, pulls.w_tcp_base, at)
    moved = np.concatenate([aside, coupled], axis=2)[:, :c]
    R = None
    if pulls.in_tracker and R_base_tracker is not None:
        R = R_base_tracker.T
        added = np.concatenate([added[:, i : i + 3] @ (R**2).T for i in range(0, c, 3)], axis=1)
        moved = np.concatenate([R @ moved[:, i : i + 3] for i in range(0, c, 3)], axis=1)
    return refreshed(
        PullResiduals(
            name=pulls.name,
            group=pulls.group,
            components=COMPONENTS[:c],
            sigma=np.sqrt(pulls.d_sigma**2 + added),
            measured=pulls.d,
            gain=gain,
            columns=np.arange(len(plan.springs), dtype=np.int64),
            offset=np.zeros_like(pulls.d),
            band_gain=np.zeros((len(pulls), c, 6)),
            band_columns=plan.bands,
            R_tracker_base=R,
            turn=plan.turn if pulls.in_tracker else None,
            moved=moved,
        ),
        chain,
        plan,
        pulls,
        plan.parameters.nominal,
    )


def refreshed(old: PullResiduals, chain: ElasticChain, plan: PullLayout, pulls: Pulls, x: Float) -> PullResiduals:
    """The block with lost motion and second-order deflection at the values x (p,) of the parameters."""
    at = with_compliance(chain, plan.springs.compliance(chain, x[: len(plan.springs)]))
    second = linear_gap(at, pulls.q, pulls.w_tcp_base, gravity=True, equilibrium=True)
    slopes = np.zeros((len(pulls), 6, 6))
    if pulls.history and at.play is not None:
        J = jacobian(at, pulls.q)
        bands = np.array([0.0 if e is None else e.half_band_rad for e in at.play])
        slope = band_slopes(at, pulls) * (plan.bands >= 0)
        slopes = J * slope[:, None, :]
        second = second + (J @ (lost_angles(at, pulls) - slope * bands)[:, :, None])[..., 0]
    c = old.measured.shape[1]
    everything = np.concatenate([second[:, :, None], slopes], axis=2)
    moved = carried(at, pulls.q, everything, pulls.p_tcp_measured)[:, :c]
    return replace(old, offset=moved[:, :, 0], band_gain=moved[:, :, 1:])


def _compliance_at(chain: ElasticChain, pulls: Pulls) -> Float:
    """(n, 6, 6) displacement of the measured point per load at the TCP."""
    return carried(chain, pulls.q, cartesian_compliance(chain, pulls.q), pulls.p_tcp_measured)


def with_honest_sigma(fit: Fit, blocks: Sequence[PullResiduals]) -> Fit:
    """The fit with standard deviations that hold for what the springs lack.

    What differs from pose to pose (friction, drift) is seen in what the fit becomes without some of them
    (:func:`counterflex.identify.solver.jackknife.with_jackknife`); bearings that are not where they are thought to be
    and directions of an element that move each other are the same in all poses, and go through the fit
    (:mod:`counterflex.identify.solver.jackknife`).
    """
    wide = with_jackknife(fit, blocks, parts_of_groups(blocks))
    return added(wide, considered(fit, blocks, [b.moved for b in blocks]))
