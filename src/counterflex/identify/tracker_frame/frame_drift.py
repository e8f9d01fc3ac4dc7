"""Drift watch: whether repeated measurements of the same fiducials show that the tracker, or the robot, has moved.

The k-th measurement of each fiducial belongs to round k. Each later round is registered on the first: the six
components of ``p_first = (1 + [r]x) p_k + t`` by weighted least squares, about the centre of the fiducials. Against no
motion at all, ``d^T C^-1 d`` is chi-squared with six degrees of freedom; the probability of a larger value by noise
alone is the significance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int
from counterflex.geometry import rotation

SIGNIFICANT: Final = 0.01


@dataclass(frozen=True, eq=False)
class Drift:
    """Motion of the tracker between the first round and a later one.

    Attributes:
        round: 1, 2, ...
        time_s: Mean time after the first round, or the round's number where no time is known.
        shift_m: (3,) how the fiducials seem to have moved, tracker axes, at their centre.
        shift_sigma_m: (3,).
        rotation_rad: (3,) rotation vector.
        rotation_sigma_rad: (3,).
        probability: Of as large a value without any motion.
    """

    round: int
    time_s: float
    shift_m: Float
    shift_sigma_m: Float
    rotation_rad: Float
    rotation_sigma_rad: Float
    probability: float

    @property
    def significant(self) -> bool:
        """Motion, not noise."""
        return self.probability < SIGNIFICANT


def rounds_of(group: Int, time_s: Float | None) -> Int:
    """(m,) round of each row: how often its fiducial was measured before (in time, else in order of rows)."""
    order = np.arange(len(group)) if time_s is None else np.argsort(time_s, kind="stable")
    out = np.zeros(len(group), dtype=np.int64)
    seen: dict[int, int] = {}
    for i in order:
        key = int(group[i])
        out[i] = seen.get(key, 0)
        seen[key] = int(out[i]) + 1
    return out


def drifts(group: Int, p_tracker: Float, sigma: Float, time_s: Float | None = None) -> tuple[Drift, ...]:
    """Motion of every later round against the first.

    Args:
        group: (m,) fiducial of each row.
        p_tracker: (m, 3) m, measured.
        sigma: (m, 3) m, standard deviations of the measurement alone.
        time_s: (m,) s, or None.

    Returns:
        One entry for every round with three fiducials or more in common with the first, not all on one line.
    """
    rounds = rounds_of(group, time_s)
    first = {int(g): i for i, g in enumerate(group) if rounds[i] == 0}
    out = []
    for k in range(1, int(rounds.max(initial=0)) + 1):
        rows = np.flatnonzero(rounds == k)
        before = np.array([first[int(g)] for g in group[rows]], dtype=np.int64)
        if len(rows) < 3:
            continue
        a, b = p_tracker[before], p_tracker[rows]
        centre = a.mean(axis=0)
        spread = np.linalg.svd(a - centre, compute_uv=False)
        if spread[1] < 1e-3 * spread[0]:
            continue
        J = np.concatenate([np.broadcast_to(np.eye(3), (len(rows), 3, 3)), -rotation.skew(a - centre)], axis=-1)
        s = np.sqrt(sigma[before] ** 2 + sigma[rows] ** 2)
        weighted = (J / s[:, :, None]).reshape(-1, 6)
        C = np.linalg.inv(weighted.T @ weighted)
        d = C @ (weighted.T @ ((b - a) / s).reshape(-1))
        size = np.sqrt(np.diag(C))
        later = float(k) if time_s is None else float(np.mean(time_s[rows]) - np.mean(time_s[before]))
        chance = float(scipy.stats.chi2.sf(float(d @ np.linalg.solve(C, d)), 6))
        out.append(Drift(k, later, d[:3], size[:3], d[3:], size[3:], chance))
    return tuple(out)
