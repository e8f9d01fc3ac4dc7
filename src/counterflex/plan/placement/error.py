"""Error that the cut leaves in a place and a posture: deflection at rest, lost motion of the drives, swing.

At every point of the thinned path, with N the directions that matter,

    e^2 = |N C w|^2 + |N J l|^2,    s = sum_i |N u_i| |u_i' dF| / omega_i^2

The lost motion l is followed along the path (:mod:`counterflex.robot.elasticity.play`), less the play that the weight
alone takes up there, as when the part frame was measured; how large it is, is known too badly to count on it to cancel
anything. The swing s is that of the modes u_i of unit modal mass
behind a step dF of the force, its largest change within :data:`STEP_S` on the piece of the path that the point stands
for. The modes swing at different rates: what of them cancels at rest does not cancel in motion, and a place that is
stiff along a normal and soft across it has a small e and a large s. A swing lasts ``1 / (zeta omega_1)``; over that
length e + s counts instead of e.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MS
from counterflex.plan.lowest_mode import ASSUMED_DAMPING
from counterflex.plan.posture.cut_path import LoadedPath
from counterflex.plan.posture.survey_kernel import POWER
from counterflex.plan.posture.way import LOST_RAD
from counterflex.plan.relative_motion import RelativeMotion
from counterflex.plan.stability.robot_modes import robot_modes_along
from counterflex.robot.elasticity import play
from counterflex.robot.elasticity.chain import ElasticChain, jacobian
from counterflex.robot.elasticity.kernels.batch import ON_RIGID, deflection_range
from counterflex.robot.model.description import Play
from counterflex.signals.preview import Mode

LIKELY_RAD: Final = 0.5 * LOST_RAD
"""Lost motion of an axis of which nothing is known: the mean between none and what makers of gears guarantee."""
STEP_S: Final = 50.0 * MS
"""Half a period at 10 Hz, where the first modes of milling robots lie: a change of the force within it makes them
swing, a slower one does not."""
STEPS: Final = 8
"""Pieces of the path whose step is looked at: those with the largest."""


@dataclass(frozen=True, eq=False)
class ErrorLeft:
    """Data of a program from which the error in any posture follows."""

    loose: ElasticChain  # the chain with the lost motion of its axes
    rows: Int  # (k,) rows of the thinned path with the largest steps of the force
    steps_part: Float  # (k, 3) N, part axes
    speed_m_s: Float  # (k,) of the tool there
    measured: Mode | None  # lowest mode of a tap test, or None

    @classmethod
    def of(
        cls, whole: LoadedPath, thin: LoadedPath, rows: Int, chain: ElasticChain, measured: Mode | None
    ) -> ErrorLeft:
        """Of a program.

        Args:
            rows: (m,) rows of the whole path that it has, rising.
            measured: Lowest mode of a tap test, or None.
        """
        step = _force_steps(whole)
        cutting = np.flatnonzero(whole.weight_m > 0.0)
        stands = np.flatnonzero(thin.weight_m > 0.0)
        ends = np.cumsum(whole.weight_m)[rows[stands]]
        piece = np.searchsorted(0.5 * (ends[1:] + ends[:-1]), np.cumsum(whole.weight_m)[cutting])
        size = np.linalg.norm(step[cutting], axis=1)
        largest = [cutting[piece == k][np.argmax(size[piece == k])] for k in range(len(stands))]
        most = np.sort(np.argsort(-np.linalg.norm(step[largest], axis=1), kind="stable")[:STEPS])
        speed = np.gradient(
            np.cumsum(whole.weight_m), np.maximum.accumulate(whole.time_s + 1e-9 * np.arange(len(whole)))
        )
        at = np.array(largest, dtype=np.int64)[most]
        return cls(_with_likely_play(chain), stands[most], step[at], speed[at], measured)

    def means(self, cut: LoadedPath, chain: ElasticChain, relative: RelativeMotion, q: Float) -> tuple[float, float]:
        """Power means over the cut of the deflection at rest, and of the error with lost motion and swing, m.

        Args:
            cut: m points, the thinned path.
            relative: Motion of the tool relative to the part in these postures.
            q: (m, 6) rad.
        """
        w, bent = np.ascontiguousarray(relative.load(cut.w_tcp_part)), np.zeros((len(q), 6))
        deflection_range(chain.compact, q, w, ON_RIGID, 0, bent, 0, len(q))
        lost = play.lost_motion(self.loose, q, w) - play.relaxed(self.loose, q)
        moved = np.einsum("nij,nj->ni", jacobian(chain, q), lost)
        rest = _across(cut.normals_part, relative.displacement(bent))
        error = np.hypot(rest, _across(cut.normals_part, relative.displacement(moved)))
        weight = cut.weight_m / (np.sum(cut.weight_m) or 1.0)
        total = float(np.sum(weight * error**POWER))
        swing, length = self._swings(cut.normals_part[self.rows], chain, relative.rows(self.rows), q[self.rows])
        share = np.minimum(weight[self.rows], length / (np.sum(cut.weight_m) or 1.0))
        there = error[self.rows]
        total += float(np.sum(share * ((there + swing) ** POWER - there**POWER)))
        return float(np.sum(weight * rest**POWER)) ** (1.0 / POWER), total ** (1.0 / POWER)

    def _swings(
        self, normals_part: Float, chain: ElasticChain, relative: RelativeMotion, q: Float
    ) -> tuple[Float, Float]:
        """(k,) m amplitudes, and the lengths over which they last."""
        if not len(q):
            return np.empty(0), np.empty(0)
        zeta = ASSUMED_DAMPING if self.measured is None else self.measured.damping_ratio
        swing, length = np.zeros(len(q)), np.zeros(len(q))
        for k, modes in enumerate(robot_modes_along(chain, q, relative.to_part, self.measured, zeta)):
            across = np.linalg.norm(normals_part[k] @ modes.shape, axis=0)
            swing[k] = float(np.sum(across * np.abs(modes.shape.T @ self.steps_part[k]) / modes.omega_rad_s**2))
            length[k] = self.speed_m_s[k] / (zeta * float(modes.omega_rad_s[0]))
        return swing, length


def _across(normals_part: Float, displacement_part: Float) -> Float:
    """(n,) m, size of displacements (n, 6) in the directions that matter."""
    out: Float = np.linalg.norm(np.einsum("ndi,ni->nd", normals_part, displacement_part[:, :3]), axis=1)
    return out


def _force_steps(path: LoadedPath) -> Float:
    """(n, 3) N, change of the force from :data:`STEP_S` before; none cuts in the air."""
    force = np.where((path.weight_m > 0.0)[:, None], path.w_tcp_part[:, :3], 0.0)
    before = np.searchsorted(path.time_s, path.time_s - STEP_S, side="right") - 1
    out: Float = force - np.where((before >= 0)[:, None], force[np.maximum(before, 0)], 0.0)
    return out


def _with_likely_play(chain: ElasticChain) -> ElasticChain:
    """The chain with play and friction where none are known: :data:`LIKELY_RAD` at a reversal, half of it each."""
    soft = np.maximum(chain.compliance[chain.torsion, 5], play.STIFFEST_RAD_NM)
    quarter = 0.25 * LIKELY_RAD
    assumed = [Play(quarter, (quarter / float(c),), (LIKELY_RAD,)) for c in soft]
    return replace(
        chain, play=tuple(own or other for own, other in zip(chain.play or (None,) * 6, assumed, strict=True))
    )
