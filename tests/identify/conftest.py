"""A small identification that every part of the machine is tried on: an elastic planar arm seen by a tracker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from counterflex.core.arrays import Bool, Float, Int
from counterflex.identify.solver.parameters import Parameter, Parameters

TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def _unit(angle: Float) -> Float:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@dataclass(frozen=True, eq=False)
class PlanarPoints:
    """Tip positions of a planar arm with two elastic joints under known forces, in the axes of a tracker.

    Parameters in order: base x, y (m), turn (rad), lengths 1, 2 (m), offsets 1, 2 (rad), compliances 1, 2 (rad/(N m)).
    """

    q: Float
    force: Float
    measured: Float
    sigma: Float
    group: Int
    name: str = "points"
    components: tuple[str, ...] = ("x m", "y m")
    lever: Float = field(default_factory=lambda: np.zeros(0))

    def _parts(self, x: Float) -> tuple[Float, Float, Float, Float, Float]:
        first = self.q[:, 0] + x[5] + x[7] * self.lever[:, 0]
        both = first + self.q[:, 1] + x[6] + x[8] * self.lever[:, 1]
        turn = np.array([[np.cos(x[2]), -np.sin(x[2])], [np.sin(x[2]), np.cos(x[2])]])
        return first, both, turn, _unit(first), _unit(both)

    def predict(self, x: Float) -> Float:
        _, _, turn, one, two = self._parts(x)
        out: Float = x[:2] + (x[3] * one + x[4] * two) @ turn.T
        return out

    def evaluate(self, x: Float) -> Float:
        out: Float = (self.measured - self.predict(x)) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        _, _, turn, one, two = self._parts(x)
        J = np.zeros((len(self.q), 2, 9))
        J[:, 0, 0] = J[:, 1, 1] = 1.0
        J[:, :, 2] = ((x[3] * one + x[4] * two) @ turn.T) @ TURN.T
        J[:, :, 3], J[:, :, 4] = one @ turn.T, two @ turn.T
        J[:, :, 5] = J[:, :, 2]
        J[:, :, 6] = (x[4] * two) @ turn.T @ TURN.T
        J[:, :, 7] = J[:, :, 5] * self.lever[:, :1]
        J[:, :, 8] = J[:, :, 6] * self.lever[:, 1:]
        # The first joint's compliance also turns what follows; the second's only the last link.
        out: Float = -J / self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> PlanarPoints:
        return replace(
            self,
            q=self.q[rows],
            force=self.force[rows],
            measured=self.measured[rows],
            sigma=self.sigma[rows],
            group=self.group[rows],
            lever=self.lever[rows],
        )


def _parameters(**changes: Parameter) -> Parameters:
    items = [
        Parameter("base.x", "m", 0.0, np.inf, scale=0.1),
        Parameter("base.y", "m", 0.0, np.inf, scale=0.1),
        Parameter("base.turn", "rad", 0.0, np.inf, scale=0.1),
        Parameter("link1.length", "m", 1.2, 2e-3, label="length of link 1"),
        Parameter("link2.length", "m", 0.9, 2e-3, label="length of link 2"),
        Parameter("axis1.offset", "rad", 0.0, 2e-3, free=False, label="zero of axis 1"),
        Parameter("axis2.offset", "rad", 0.0, 2e-3, label="zero of axis 2"),
        Parameter("axis1.compliance", "rad/(N m)", 4e-7, 0.5, log=True, label="compliance of axis 1"),
        Parameter("axis2.compliance", "rad/(N m)", 6e-7, 0.5, log=True, label="compliance of axis 2"),
    ]
    return Parameters.of(changes.get(p.name.replace(".", "_"), p) for p in items)


@dataclass(frozen=True)
class PlanarArm:
    """Makes parameters, truths and measurements of the arm."""

    def parameters(self, **changes: Parameter) -> Parameters:
        return _parameters(**changes)

    def truth(self, parameters: Parameters, rng: np.random.Generator) -> Float:
        """Values drawn from the priors; where there is none, anywhere of the order of the scale."""
        u = np.where(parameters.free, rng.standard_normal(len(parameters)), 0.0)
        return parameters.values(u)

    def points(
        self,
        truth: Float,
        rng: np.random.Generator,
        *,
        count: int = 40,
        sigma: float = 1e-4,
        noise: Callable[[tuple[int, int]], Float] | None = None,
        load_n: float = 500.0,
        repeats: int = 1,
    ) -> PlanarPoints:
        """Measurements in random poses under random forces; ``noise`` gives unit noise of a shape."""
        poses = -(-count // repeats)
        q = np.repeat(rng.uniform([-1.5, 0.4], [1.5, 2.4], (poses, 2)), repeats, axis=0)[:count]
        force = load_n * rng.standard_normal((count, 2))
        first = q[:, 0]
        arm2 = 0.9 * _unit(first + q[:, 1])
        arm1 = 1.2 * _unit(first) + arm2
        lever = np.stack([a[:, 0] * force[:, 1] - a[:, 1] * force[:, 0] for a in (arm1, arm2)], axis=1)
        group = np.repeat(np.arange(poses, dtype=np.int64), repeats)[:count]
        clean = PlanarPoints(q, force, np.zeros((count, 2)), np.full((count, 2), sigma), group, lever=lever)
        unit = rng.standard_normal((count, 2)) if noise is None else noise((count, 2))
        return replace(clean, measured=clean.predict(truth) + sigma * unit)


@pytest.fixture(scope="session")
def arm() -> PlanarArm:
    return PlanarArm()
