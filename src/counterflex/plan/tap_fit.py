"""Masses of the elastic chain fitted to a tap test: a measured frequency response at the tip of the tool.

Free are the logarithms of every mass, of one factor on all stiffnesses and of the damping beta, each drawn to what the
cell file says with the standard deviation of that statement (maximum a posteriori, Gauss-Newton on real and imaginary
parts). A frequency alone tells only k/m; how far the tip moves below the first mode tells k.

Source: Friswell and Mottershead 1995, Finite Element Model Updating in Structural Dynamics, ch. 8 (weighted updating
with a prior). Heylen and Lammens 1996, FRAC: A consistent way of comparing frequency response functions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from counterflex.core.arrays import Bool, Float, Int, as_float
from counterflex.core.errors import InputError
from counterflex.plan.elastic_motion import jacobians, stiffness_of
from counterflex.plan.elastic_motion_kernel import AXES
from counterflex.plan.modes import frequency_response, inertia_of_bodies
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.description import Servo

Complex = NDArray[np.complex128]
ERROR_SHARE: Final = 0.05
"""Standard deviation of a measured response, of its own size and of the root mean square of all: hammer and
accelerometer are calibrated to a few percent, and the model has its own errors of form."""
DAMPING_SIGMA: Final = 0.7
"""Of the logarithm of the damping: a factor of three either way."""
LEAST_ROWS: Final = 8
_SEEN: Final = 0.8
"""Share of its prior standard deviation from which a value is called known by the prior alone."""


@dataclass(frozen=True, eq=False)
class Tap:
    """A tap test in one posture."""

    omega_rad_s: Float  # (n,) > 0
    force_base: Float  # (n, 3) direction of the tap, base axes, unit length
    motion_base: Float  # (n, 3) direction in which motion was measured, unit length
    receptance: Complex  # (n,) complex, m/N


@dataclass(frozen=True, eq=False)
class MassFit:
    """Masses, stiffness and damping of a chain by a tap test."""

    bodies: Int  # (k,) bodies of the chain that have a mass
    factor: Float  # (k,) on their masses
    sigma: Float  # (k,) standard deviation of the logarithm of each factor
    seen: Bool  # (k,) True where the data say more than the prior did
    stiffness_factor: float  # on all stiffnesses
    damping_s: float  # beta
    before: Complex  # (n,) response of the model as it was
    after: Complex  # (n,) as fitted

    def applied(self, chain: ElasticChain) -> ElasticChain:
        """The chain with the masses and compliances that were fitted."""
        mass = chain.mass.copy()
        mass[self.bodies] *= self.factor
        return replace(chain, mass=mass, compliance=chain.compliance / self.stiffness_factor)


def fit_masses(
    chain: ElasticChain, q: Float, tap: Tap, damping_s: float, mass_sigma: Float, stiffness_sigma: float
) -> MassFit:
    """Fit masses, one factor on stiffnesses, and damping.

    Args:
        chain: With masses; its loop gains count.
        q: (6,) rad, posture of the tap test.
        tap: What was measured.
        damping_s: beta of the damping D = beta K to begin with.
        mass_sigma: (bodies,) standard deviation of the logarithm of each mass.
        stiffness_sigma: The same of the factor on all stiffnesses.

    Raises:
        InputError: Too few rows.
    """
    if len(tap.omega_rad_s) < LEAST_ROWS:
        raise InputError("too few rows to fit masses to", value=len(tap.omega_rad_s), limit=f">= {LEAST_ROWS}")
    angles = as_float("q", q, (6,))[None]
    J, stiffness = jacobians(chain, angles)[0][0], stiffness_of(chain, angles)[0]
    bodies, parts = inertia_of_bodies(chain, q)
    servo = chain.servo or (None,) * AXES
    omega, where = np.unique(tap.omega_rad_s, return_inverse=True)
    sigma = np.concatenate([mass_sigma[bodies], [stiffness_sigma, DAMPING_SIGMA]])
    model = _TapModel(tap, omega, where, J, stiffness, parts, servo, damping_s)
    size = np.abs(tap.receptance)
    weight = 1.0 / (ERROR_SHARE * np.hypot(size, np.sqrt(np.mean(size**2))))
    done = scipy.optimize.least_squares(
        lambda p: model.residuals(p, weight, sigma), np.zeros(len(sigma)), x_scale=sigma
    )
    spread = np.sqrt(np.diag(np.linalg.inv(done.jac.T @ done.jac)))
    # A fit that is better than the stated error does not make that error smaller.
    chi = max(1.0, float(np.sum(done.fun**2)) / (len(done.fun) - len(sigma)))
    # Nothing is known worse than before the test.
    spread = np.minimum(spread * np.sqrt(chi), sigma)
    return MassFit(
        bodies=bodies,
        factor=np.exp(done.x[:-2]),
        sigma=spread[:-2],
        seen=spread[:-2] < _SEEN * sigma[:-2],
        stiffness_factor=float(np.exp(done.x[-2])),
        damping_s=damping_s * float(np.exp(done.x[-1])),
        before=model.response(np.zeros(len(sigma))),
        after=model.response(done.x),
    )


@dataclass(frozen=True, eq=False)
class _TapModel:
    """Response of the robot to a tap, by p: logarithms of factors on masses, on stiffness and on damping."""

    tap: Tap
    omega: Float
    where: Int  # (rows,) place of each row among omega
    J: Float
    stiffness: Float
    parts: Float  # (bodies, n, n) inertia of each body
    servo: tuple[Servo | None, ...]
    damping_s: float

    def response(self, p: Float) -> Complex:
        """(rows,) receptance."""
        M = np.einsum("b,bij->ij", np.exp(p[:-2]), self.parts)
        damping_s = self.damping_s * float(np.exp(p[-1]))
        G = frequency_response(M, self.stiffness * np.exp(p[-2]), self.J, damping_s, self.servo, self.omega)
        out: Complex = np.einsum("na,nab,nb->n", self.tap.motion_base, G[self.where, :3, :3], self.tap.force_base)
        return out

    def residuals(self, p: Float, weight: Float, sigma: Float) -> Float:
        """Real and imaginary parts of the weighted error, and the priors."""
        off = weight * (self.response(p) - self.tap.receptance)
        return np.concatenate([off.real, off.imag, p / sigma])


def frac(measured: Complex, computed: Complex) -> float:
    """Frequency response assurance criterion, ``|m^H c|^2 / ((m^H m) (c^H c))``: 1 where they are proportional."""
    return float(
        np.abs(np.vdot(measured, computed)) ** 2 / (np.vdot(measured, measured) * np.vdot(computed, computed)).real
    )
