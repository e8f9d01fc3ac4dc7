"""Chatter in a place: how the cut feeds the robot's modes, by the criterion of ``plan stability`` at a few points.

Of the stretches of a program those with the largest ``T |A|`` of every direction of feed and tool are looked at. In
each candidate they are met in another posture. How far the place is from chatter is said by the least damping ratio
that the modes have left there while they cut :data:`MARGIN` times as deep
(:func:`counterflex.plan.stability.criterion.least_damping`), of robots that are drawn about the published one: nine of
ten have more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.cutting.coefficients import ForceLaw
from counterflex.plan.elastic_motion import coordinates
from counterflex.plan.inputs import Setting
from counterflex.plan.lowest_mode import Damping
from counterflex.plan.stability.criterion import least_damping
from counterflex.plan.stability.robot_modes import drawn_modes
from counterflex.plan.stability.stretches import Stretch
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.signals.preview import Mode

MARGIN: Final = 1.5
"""Factor on the depth at which the damping is looked at: handbook forces are known to 30 % (standard deviation of the
logarithm, as ``cell check`` has it), so nine of ten are below ``exp(1.28 0.3) = 1.5``."""
STIFFNESS_SIGMA: Final = 0.35
"""Of the logarithm of each published stiffness, as ``cell check`` has it."""
ROBOTS: Final = 10
"""Robots that are drawn; the one but worst counts. Softer in another axis the same arm swings in another direction."""
DIRECTIONS: Final = 8
"""Sectors of the direction of feed."""


@dataclass(frozen=True, eq=False)
class Feeding:
    """Effect of the cut on a swing at k points of a thinned path."""

    rows: Int  # (k,) rows of the thinned path, rising
    A_part: Float  # (k, 3, 3) N/m mean directional matrices at the depth that is cut, part axes
    period_s: Float  # (k,) s, tooth periods
    measured: Mode | None  # lowest mode of a tap test, or None
    damping: Damping  # of the robot's own modes

    def least_damping(self, chain: ElasticChain, q: Float, to_part: Float) -> float:
        """Least damping ratio that nine of ten robots have left while they cut; at most the robot's own.

        Args:
            q: (m, 6) rad along the thinned path.
            to_part: (1, 6, 6) or, for each of the k points, (k, 6, 6): see
                :func:`counterflex.plan.stability.robot_modes.robot_modes`.
        """
        count = len(coordinates(chain)[0])
        drawn = np.random.default_rng(0).standard_normal((ROBOTS, count))
        out = np.full(ROBOTS, self.damping.ratio)
        robots = drawn_modes(
            chain, q[self.rows], to_part, self.measured, self.damping.ratio, np.exp(STIFFNESS_SIGMA * drawn)
        )
        for own, A, T in zip(robots, self.A_part, self.period_s.tolist(), strict=True):
            for k, modes in enumerate(own):
                out[k] = min(out[k], least_damping(modes, MARGIN * A, T))
        return float(np.sort(out)[1])


def feeding(stretches: Sequence[Stretch], rows: Int, setting: Setting, law: ForceLaw) -> Feeding:
    """Compute the effect of the cut on swings along a thinned path.

    ``rows``: (m,) rows of the whole path that the thinned one has, rising. ``setting``: tools; a mode of a tap test;
    damping.
    """
    strongest: dict[tuple[int, int], tuple[float, int, Float, float]] = {}
    for piece in stretches:
        R = piece.R_part_feed
        A = R @ piece.process(law, setting.cutter_of(piece.tool).flutes).mean @ R.T
        angle = np.arctan2(piece.direction_part[1], piece.direction_part[0])
        sector = round(float(angle) / (2.0 * np.pi) * DIRECTIONS) % DIRECTIONS
        size = piece.period_s * float(np.linalg.norm(A))
        if size > strongest.get((piece.tool, sector), (0.0,))[0]:
            strongest[piece.tool, sector] = size, piece.row, A, piece.period_s
    values = sorted(strongest.values(), key=lambda one: one[1])
    near = [int(np.argmin(np.abs(rows - row))) for _, row, _, _ in values]
    return Feeding(
        np.array(near, dtype=np.int64),
        np.array([A for _, _, A, _ in values]).reshape(-1, 3, 3),
        np.array([T for *_, T in values]),
        setting.mode,
        setting.damping,
    )
