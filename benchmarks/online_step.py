"""The online step of one chain as an object with its buffers, for benchmarks and tests.

The arithmetic is :mod:`counterflex.robot.elasticity.kernels.step`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import InputError
from counterflex.core.records import records
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.records import STEP, WORK, Elastic
from counterflex.robot.elasticity.kernels.step import step


class ElasticStep:
    """The online step of one chain, with buffers that are allocated once.

    Deflection of the TCP at commanded angles q under the wrench w, and the angles q_c whose *deflected* pose is the
    undeflected pose of q: two Newton steps with the rigid Jacobian at q on ``fk_elastic(q_c, w) = fk_rigid(q)``. Loads
    on the rigid geometry, nonlinear composition (Haehn2020 eq. 2-9). Near singularities (``sigma`` below DAMPING_BELOW)
    the step is damped, each Newton step is clamped to STEP_LIMIT, and below REFUSE_BELOW no correction is given:
    ``q_c = q``.

    Call it with q and w, or write into ``q`` and ``w`` and call :meth:`run`. Results are views of one record that the
    next call overwrites; copy what must last. Not safe to share between threads.

    Attributes:
        q: (6,) rad, input: angles the controller shows.
        w: (6,) N, N m, input: wrench about the TCP in base axes.
        T0: (4, 4) rigid pose of the TCP at q.
        Te: (4, 4) deflected pose at q.
        C: (6, 6) Cartesian compliance at q, base axes at the TCP.
        d: (6,) deflection ``Te - T0``: translation m, rotation vector rad, base axes.
        q_c: (6,) rad, corrected angles.
        Tc: (4, 4) rigid pose at q_c: what a Cartesian correction commands.
        residual: (6,) what is left at q_c: deflected pose minus T0.
        status: 0, or bits DAMPED, CLAMPED, REFUSED.
    """

    def __init__(self, chain: ElasticChain, *, gravity: bool = False) -> None:
        """Allocate the buffers; ``gravity`` adds own weight and payload to the load, so that sag is undone too."""
        m = len(chain.compact.stations) - 1
        self.chain = chain
        self.status = 0
        self._given = np.zeros(12)
        self._results = records(STEP)
        self._elastic = Elastic(chain.compact, self._results, np.zeros((m + 1, 12)), np.zeros((m, 6)), records(WORK))
        self._gravity = int(gravity)
        self.q = self._given[:6]
        self.w = self._given[6:]
        result = self._results[0]
        self.T0, self.Te, self.Tc = (array.reshape(4, 4) for array in (result.T0, result.Te, result.Tc))
        self.C = result.compliance.reshape(6, 6)
        self.d, self.q_c, self.residual = result.deflection, result.q, result.residual
        self._sigma = self._results["sigma"]
        self.run()

    @property
    def sigma(self) -> float:
        """Distance from singularity: 1/sqrt(6) to 1 times the smallest singular value of J (1 m counts as 1 rad)."""
        return float(self._sigma[0])

    def run(self) -> int:
        """Step for what stands in ``q`` and ``w``. Returns the status bits."""
        self.status = step(self._elastic, self._given, self._gravity)
        return self.status

    def __call__(self, q: Float, w_tcp_base: Float) -> int:
        """Step for angles (6,) rad and wrench (6,) N, N m; anything NumPy can copy. Returns the status bits.

        Raises:
            InputError: Wrong shape. Values are not checked here: NaN in gives NaN out with status REFUSED.
        """
        try:
            self.q[:] = q
            self.w[:] = w_tcp_base
        except ValueError as fault:
            raise InputError(f"the step takes six angles and six wrench components: {fault}") from fault
        return self.run()


class Steps(NamedTuple):
    """Results of many steps, a row each: as of :class:`ElasticStep`."""

    d: Float
    q_c: Float
    residual: Float
    sigma: Float
    status: Int


def steps(chain: ElasticChain, q: Float, w_tcp_base: Float, *, gravity: bool = False) -> Steps:
    """Step for angles (n, 6) rad and wrenches (n, 6) N, N m, one after the other."""
    step = ElasticStep(chain, gravity=gravity)
    rows = []
    for angles, load in zip(q, w_tcp_base, strict=True):
        status = step(angles, load)
        rows.append((step.d.copy(), step.q_c.copy(), step.residual.copy(), step.sigma, status))
    return Steps(*(np.array(column) for column in zip(*rows, strict=True)))
