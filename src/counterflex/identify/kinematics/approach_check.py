"""Residuals that depend on the side from which the axes came, where lost motion is not fitted.

Half of the lost motion h of each axis moves a row by ``G_a s_a h_a``, s the sense of approach and G the derivative by
the angle of the axis. All parameters of the fit move with it, to first order (covariance C, Jacobian J, residuals r)::

    S = K^T K - K^T J C J^T K + 1 / prior^2,   g = K^T r,   h = S^-1 g,   K_a = G_a s_a

``g^T S^-1 g`` is how much h lowers the sum of squares. Residuals of a real arm are no white noise, so chance is
counted, not computed: the same with the senses dealt to the rows anew, :data:`DEALS` times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM, URAD
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.geometry.arm_geometry import ArmGeometry
from counterflex.identify.geometry.pose_residuals import TrackerResiduals
from counterflex.identify.kinematics.approach_sense import CHANNEL, PRIOR_RAD, SEEN, in_order, senses
from counterflex.identify.kinematics.setup import POSE_KINDS, Setup, by_channel
from counterflex.identify.solver.fit import Fit

DEALS: Final = 499
"""Times that the senses are dealt anew."""
CHANCE: Final = 0.005
"""Share of the deals that may lower the residuals as much."""
FEWEST: Final = 20
"""Rows below which nothing is looked for."""
_STEP_RAD: Final = 1e-5


def approach_remarks(setup: Setup, fit: Fit, data: Sequence[Dataset]) -> tuple[str, ...]:
    """Say by how much the residuals depend on the direction of approach, by the order of the rows."""
    sense = _senses(data)
    blocks = [
        i for i, b in enumerate(setup.blocks) if isinstance(b, TrackerResiduals) and isinstance(b.arm, ArmGeometry)
    ]
    if len(blocks) != len(sense) or not blocks or len(np.concatenate(sense)) < FEWEST:
        return ()
    free, x = fit.free_index, fit.values
    slope = fit.parameters.slope(x)[free]
    r, J, G, row = [], [], [], []
    for i, first in zip(blocks, np.cumsum([0, *(len(part) for part in sense)]), strict=False):
        b, scale = cast(TrackerResiduals, setup.blocks[i]), np.sqrt(fit.weights[i])[:, None] / fit.sigma_factors[i]
        r.append((b.evaluate(x) * scale).ravel())
        J.append((b.jacobian(x)[:, :, free] * slope * scale[:, :, None]).reshape(-1, len(free)))
        G.append((_by_angle(b, x) * scale[:, :, None]).reshape(-1, 6))
        row.append(np.repeat(np.arange(first, first + len(b.group)), len(b.components)))
    rows = _Rows(np.concatenate(r), np.concatenate(J), np.concatenate(G), np.concatenate(row), fit.covariance)
    s = np.concatenate(sense)
    h, sigma, gain = rows.lost(s)
    rng = np.random.default_rng(0)
    others = np.array([rows.lost(s[rng.permutation(len(s))])[2] for _ in range(DEALS)])
    chance = (1.0 + float(np.sum(others >= gain))) / (1.0 + DEALS)
    axes = [a for a in range(len(h)) if h[a] > SEEN * sigma[a]]
    if chance > CHANCE or not axes:
        return ()
    size = _moved(setup, fit, blocks, sense, np.where(np.isin(np.arange(len(h)), axes), h, 0.0))
    named = ", ".join(f"axis {a + 1} +-{h[a] / URAD:.0f} urad" for a in axes)
    known = all(d.has(CHANNEL) for d in data if d.kind in POSE_KINDS)
    how = "" if known else " (if the rows stand in the order in which they were measured)"
    return (
        f"The residuals depend on the direction of approach{how}: {named}, {np.mean(size) / MM:.2g} mm at the target "
        f"in the mean and {np.max(size) / MM:.2g} mm at most (chance {chance:.2g}). Lost motion was not fitted: "
        f"--set play={'known' if known else 'order'} fits it and keeps it if poses held out are predicted better.",
    )


def _senses(data: Sequence[Dataset]) -> list[Float]:
    """(m, 6) senses of each part of each dataset of poses, in the order of its residuals."""
    out = []
    for d in data:
        if d.kind in POSE_KINDS:
            stated = d if d.has(CHANNEL) else replace(d, channels={**d.channels, CHANNEL: in_order(d)})
            out += [s for _, part in by_channel(stated, "target") if (s := senses(part)) is not None]
    return out


def _by_angle(b: TrackerResiduals, x: Float) -> Float:
    """(n, c, 6) derivative of weighted residuals by minus the angle of each axis."""
    before = b.evaluate(x)
    out = np.zeros((*before.shape, 6))
    for axis in range(6):
        out[:, :, axis] = (_turned(b, _STEP_RAD * np.eye(6)[axis]).evaluate(x) - before) / _STEP_RAD
    return out


def _turned(b: TrackerResiduals, back: Float) -> TrackerResiduals:
    """The residuals of an arm whose links stay behind by (6,) or (n, 6) rad."""
    return replace(b, arm=replace(cast(ArmGeometry, b.arm), q=cast(ArmGeometry, b.arm).q - back))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Weighted numbers of all rows: residuals, derivatives by parameters and by angles, row of each; covariance."""

    r: Float
    J: Float
    G: Float
    row: Int
    C: Float

    def lost(self, s: Float) -> tuple[Float, Float, float]:
        """Half of the lost motion (6,) rad, its standard deviation, and by how much it lowers the sum of squares."""
        K = -self.G * s[self.row]
        A = self.J.T @ K
        S = K.T @ K - A.T @ self.C @ A + np.eye(6) / PRIOR_RAD**2
        g = K.T @ self.r
        h = np.asarray(np.linalg.solve(S, g), dtype=np.float64)
        sigma = np.asarray(np.sqrt(np.diag(np.linalg.inv(S))), dtype=np.float64)
        return h, sigma, float(g @ h)


def _moved(setup: Setup, fit: Fit, blocks: Sequence[int], sense: Sequence[Float], h: Float) -> Float:
    """(n,) m by which lost motion moves the target."""
    out = []
    for i, s in zip(blocks, sense, strict=True):
        b = cast(TrackerResiduals, setup.blocks[i])
        moved = _turned(b, s * h).evaluate(fit.values) - b.evaluate(fit.values)
        out.append(np.linalg.norm((moved * b.sigma)[:, :3], axis=1))
    return np.concatenate(out)
