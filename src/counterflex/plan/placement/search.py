"""Global search of the pose of the part: Sobol points, differential evolution and Nelder-Mead of scipy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float
from counterflex.core.progress import Progress, silent
from counterflex.geometry import pose
from counterflex.plan.placement.candidate import CHATTER, Candidate, Site, judge
from counterflex.robot.model.description import Opw

POPULATION: Final = 64
"""Candidates of a generation; the first are Sobol points, which need a power of two."""


@dataclass(frozen=True)
class PlacementBounds:
    """Bounds of the pose of the part."""

    # (4 + k,) m, m, m, rad: least x and y of the middle of the program and z of the part frame, robot base at zero of
    # its external axes; least rotation about z; least values of k external axes, m or rad
    low: tuple[float, ...]
    high: tuple[float, ...]  # (4 + k,) largest


@dataclass(frozen=True, eq=False)
class CandidatePoses:
    """Poses that a candidate gives, relative to the robot."""

    # (4, 4) in the robot base: frame of the program, or tool frame of the spindle where the robot holds the part
    T_base_standing: Float
    # (4, 4) robot base of the present cell in that of the candidate: external axes may carry the robot away from what
    # stands on the floor. None: it stays
    T_base_before: Float | None = None


@dataclass(frozen=True, eq=False)
class JudgedPlacements:
    """All candidates that were judged."""

    places: Float  # (n, 4 + k) m, m, m, rad, as Region has them
    candidates: list[Candidate]  # n, in the order in which they were judged
    least_damping: float = -np.inf  # damping ratio in the cut that was asked for; -inf: nobody looked

    def ranked(self) -> list[int]:
        """Indices of those that can be run, the smallest error first."""
        some = [k for k, candidate in enumerate(self.candidates) if not candidate.refused]
        return sorted(some, key=lambda k: self.candidates[k].error_m)

    def steadied(self, present: Candidate) -> JudgedPlacements:
        """The same, with those refused in which the cut feeds a swing (:attr:`Candidate.least_damping`).

        Asked for is a damping ratio of 0 with the robot's own damping as it was stated; where no candidate has it, what
        the present place has; where no candidate has that either, the largest that was found.
        """
        values = [c.least_damping for c in self.candidates if not c.refused and not np.isnan(c.least_damping)]
        if not values:
            return self
        most = max(values)
        limit = 0.0 if most >= 0.0 else min(present.least_damping, most)
        kept = [c if c.refused or not c.least_damping < limit else replace(c, refused=CHATTER) for c in self.candidates]
        return JudgedPlacements(self.places, kept, limit)

    def refusals(self) -> dict[str, int]:
        """Number of candidates that each constraint refused, the most first."""
        reasons = [candidate.refused for candidate in self.candidates if candidate.refused]
        return {reason: reasons.count(reason) for reason in sorted(set(reasons), key=reasons.count, reverse=True)}


def usual_region(opw: Opw) -> PlacementBounds:
    """In front of the robot, from the height of its foot to that of axis 2, any rotation of the part.

    With R the reach (:meth:`Opw.reach_m`): x from 0.2 to 1 R, y half of R to both sides.
    """
    reach = opw.reach_m()
    return PlacementBounds((0.2 * reach, -0.5 * reach, 0.0, -np.pi), (reach, 0.5 * reach, 0.5 * reach, np.pi))


def placed(place: Float, middle: Float, R_turned: Float) -> Float:
    """Pose of the part.

    Args:
        place: (4,) x, y of the middle of the program and z of the part frame, m; rotation about z, rad.
        middle: (3,) m, middle of the program in the part frame; only what lies level in the base is used.
        R_turned: (3, 3) orientation of the part frame in the base at rotation 0.

    Returns:
        (4, 4) part frame in the base.
    """
    c, s = np.cos(place[3]), np.sin(place[3])
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_turned
    level = (R @ middle) * [1.0, 1.0, 0.0]
    return pose.make(R, np.asarray(place[:3]) - level)


def search(
    site: Site,
    region: PlacementBounds,
    seen: Callable[[Float], CandidatePoses],
    count: int,
    seed: int = 1,
    progress: Progress = silent,
) -> JudgedPlacements:
    """Judge ``count`` poses of the part: Sobol points over the region, differential evolution, Nelder-Mead at the end.

    ``region``: where the part may stand. ``seen``: where a candidate (4 + k,) puts things. ``count``: candidates;
    rounded up to whole generations of :data:`POPULATION`.
    """
    low, high = np.array(region.low), np.array(region.high)
    free = high > low
    generations = max(1, -(-count // POPULATION))
    judged: list[tuple[Float, Candidate]] = []
    cost = partial(_judge, site, region, seen, judged, generations * POPULATION, progress)
    if free.any():
        bounds = list(zip(low[free], high[free], strict=True))
        # The first generation is the Sobol start, the last is left to Nelder-Mead: count is kept.
        best = scipy.optimize.differential_evolution(
            cost,
            bounds,
            maxiter=max(0, generations - 2),
            popsize=max(1, POPULATION // int(free.sum())),
            init="sobol",
            tol=0.0,
            polish=False,
            rng=seed,
        )
        if generations > 1:
            refined = {"maxfev": POPULATION, "xatol": 0.0, "fatol": 0.0}
            scipy.optimize.minimize(cost, best.x, method="Nelder-Mead", bounds=bounds, options=refined)
    else:
        cost(np.empty(0))
    return JudgedPlacements(np.array([place for place, _ in judged]), [candidate for _, candidate in judged])


def _judge(
    site: Site,
    region: PlacementBounds,
    seen: Callable[[Float], CandidatePoses],
    judged: list[tuple[Float, Candidate]],
    total: int,
    progress: Progress,
    x: Float,
) -> float:
    """Judge one candidate by its free coordinates x, and keep it."""
    place, high = np.array(region.low), np.array(region.high)
    place[high > place] = x
    there = seen(place)
    candidate = judge(site, there.T_base_standing, there.T_base_before)
    judged.append((place, candidate))
    progress(min(1.0, len(judged) / total))
    return candidate.cost
