"""The instrumented spindle holder: from the strain of its bridges to the force at the tool (Denkena2015 section 4).

``s = bias + kelvin (T - T_ref) + S w`` with ``w = G(p) f`` the load about the holder's origin of a force at the tool
tip p, ``G = [1; [p]x]``. So one (n, 6) matrix S serves every tool: the matrix of a new tool length or direction follows
from the lever, not from a new calibration. The other way, ``f = M s`` (eq. 8), with

    M = (K^T N^-1 K + P^-1)^-1 K^T N^-1,  K = S G(p)

the generalised least-squares estimate for noise covariance N, and with the prior covariance P of the force its
regularised form (ridge regression).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float, as_float, frozen
from counterflex.core.errors import InputError
from counterflex.geometry.rotation import skew
from counterflex.sensing.holder_beam import Gauge, HolderBeam

PRINTED_M: Float = np.array(
    [
        [-2.17, 1.58, -0.26, 3.45, 13.23, 0.46],
        [-3.01, -0.41, 0.27, 2.32, -2.34, -0.23],
        [-5.08, -3.31, 0.83, 6.62, 17.61, 2.45],
    ]
)
"""Measurement matrix printed in Denkena2015 eq. 9, rows x, y, z, in units that the paper does not give."""
PRINTED_M.flags.writeable = False


@dataclass(frozen=True, eq=False)
class StrainHolder:
    """Constants of an instrumented holder.

    Attributes:
        p_holder_tcp: (3,) m, tool tip in the holder frame.
        sensitivity: (n, 6) 1/N, 1/(N m); see :meth:`HolderBeam.sensitivity`.
        bias: (n,) strain with no load at the reference temperature.
        per_kelvin: (n,) 1/K, what is left of temperature after the bridges' own compensation.
        reference_c: Reference temperature, deg C.
        noise: (n,) standard deviation of a sample's strain.
        segment: Body of the end effector whose frame is the holder's, where one is named.
    """

    beam: HolderBeam
    gauges: tuple[Gauge, ...]
    p_holder_tcp: Float
    sensitivity: Float
    bias: Float
    per_kelvin: Float
    noise: Float
    reference_c: float = 20.0
    segment: str = field(default="")

    def __post_init__(self) -> None:
        """Check shapes.

        Raises:
            InputError: A wrong shape, fewer than three bridges, or noise that is not positive.
        """
        n = len(self.gauges)
        if n < 3:
            raise InputError("bridges of the holder", value=n, limit=">= 3 for three forces")
        shapes = {"p_holder_tcp": (3,), "sensitivity": (n, 6), "bias": (n,), "per_kelvin": (n,), "noise": (n,)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(as_float(f"holder: {name}", getattr(self, name), shape)))
        if np.any(self.noise <= 0.0):
            raise InputError("noise of a bridge", value=float(self.noise.min()), limit="> 0")

    @classmethod
    def designed(
        cls, beam: HolderBeam, gauges: tuple[Gauge, ...], p_holder_tcp: Float, noise: float, segment: str = ""
    ) -> StrainHolder:
        """The holder as its drawing promises, before any calibration."""
        n = len(gauges)
        return cls(
            beam,
            gauges,
            p_holder_tcp,
            beam.sensitivity(gauges),
            np.zeros(n),
            np.zeros(n),
            np.full(n, noise),
            segment=segment,
        )

    def forces(self, strain: Float, M: Float, temperature_c: Float | float | None = None) -> Float:
        """Forces (..., 3) N of strains (..., n): ``M (s - bias - kelvin (T - T_ref))``."""
        s = as_float("strain", strain) - self.bias
        if temperature_c is not None:
            s = s - (np.asarray(temperature_c, dtype=np.float64) - self.reference_c)[..., None] * self.per_kelvin
        out: Float = s @ M.T
        return out

    def matrix(
        self, p_holder_tcp: Float | None = None, R_holder_tool: Float | None = None, prior_n: float | None = None
    ) -> Float:
        """M (3, n) N for a tool: forces in axes of the tool from strains.

        Args:
            p_holder_tcp: (3,) m tool tip; None is that of the holder.
            R_holder_tool: (3, 3) axes of the tool (or of feed, normal, axis) in the holder; None is the holder's.
            prior_n: Standard deviation of the force before it is measured (ridge); None does not regularise.
        """
        K = tool_matrix(self.sensitivity, self.p_holder_tcp if p_holder_tcp is None else p_holder_tcp)
        M = force_matrix(K, np.diag(self.noise**2), prior_n)
        return M if R_holder_tool is None else np.asarray(R_holder_tool, dtype=np.float64).T @ M


def lever(p_holder_load: Float) -> Float:
    """G (..., 6, 3): load about the holder's origin of a force at a point (..., 3) m."""
    p = np.asarray(p_holder_load, dtype=np.float64)
    G = np.zeros((*p.shape[:-1], 6, 3))
    G[..., :3, :] = np.eye(3)
    G[..., 3:, :] = skew(p)
    return G


def tool_matrix(sensitivity: Float, p_holder_tcp: Float) -> Float:
    """K (..., n, 3) 1/N: strain per force at the tool tip, ``S G(p)``."""
    out: Float = sensitivity @ lever(p_holder_tcp)
    return out


def force_matrix(K: Float, noise_covariance: Float, prior_n: float | None = None) -> Float:
    """Generalised least-squares (with ``prior_n`` ridge) matrix M (3, n) N of strain to force.

    Args:
        K: (n, 3) 1/N.
        noise_covariance: (n, n) of the strains.
        prior_n: Standard deviation of each force component before, N; None is no knowledge.

    Raises:
        InputError: A force direction is not seen and no prior is given.
    """
    weighted = np.linalg.solve(noise_covariance, K)
    information = K.T @ weighted
    if prior_n is not None:
        information = information + np.eye(3) / prior_n**2
    elif np.linalg.cond(information) > 1e14:
        raise InputError(
            "the bridges do not determine the force in one direction", hint="Give prior_n, or place gauges elsewhere"
        )
    out: Float = np.linalg.solve(information, weighted.T)
    return out


def regressed_matrix(
    strain: Float, force_n: Float, ridge: float = 0.0, weight: Float | None = None
) -> tuple[Float, Float]:
    """M by regression of measured forces on measured strains, as the paper does it (eq. 8), with zero offset free.

    ``min sum weight |f - f0 - M s|^2 + ridge n |M D|^2`` with D the spread of each strain, so that ``ridge`` is without
    unit; 0 is ordinary least squares.

    Args:
        strain: (m, n).
        force_n: (m, 3) N.
        ridge: Regularisation, relative to the strains' variance.
        weight: (m,) or None for all alike.

    Returns:
        M (3, n) and f0 (3,) N.

    Raises:
        InputError: Fewer rows than unknowns and no regularisation.
    """
    s, f = as_float("strain", strain, (None, None)), as_float("force_n", force_n, (len(strain), 3))
    if len(s) <= s.shape[1] and ridge <= 0.0:
        raise InputError("too few loads for a regression", value=len(s), limit=f"> {s.shape[1]} or a ridge > 0")
    w = np.ones(len(s)) if weight is None else as_float("weight", weight, (len(s),))
    w = w / w.sum()
    s0, f0 = w @ s, w @ f
    spread = np.maximum(np.sqrt(w @ (s - s0) ** 2), 1e-300)
    z = (s - s0) / spread
    A = (z * w[:, None]).T @ z + ridge * np.eye(s.shape[1])
    M: Float = np.linalg.solve(A, (z * w[:, None]).T @ (f - f0)).T / spread
    return M, f0 - M @ s0


@dataclass(frozen=True, eq=False)
class Sight:
    """What the bridges see of a force.

    Attributes:
        sigma_n: (3,) N standard deviation of each component of the estimated force for one sample.
        condition: Largest by smallest singular value of the whitened K.
        directions: (3, 3) rows: unit force directions from best to worst seen.
        direction_sigma_n: (3,) N standard deviation along each.
    """

    sigma_n: Float
    condition: float
    directions: Float
    direction_sigma_n: Float


def sight(K: Float, noise_covariance: Float) -> Sight:
    """Which force directions bridges see, and how well.

    Args:
        K: (n, 3) 1/N strain per force.
        noise_covariance: (n, n).
    """
    L = np.linalg.cholesky(noise_covariance)
    _, s, vt = np.linalg.svd(np.linalg.solve(L, K))
    s = np.maximum(s, 1e-300)
    sigma = np.sqrt(np.sum((vt.T / s) ** 2, axis=1))
    return Sight(sigma, float(s[0] / s[-1]), vt, 1.0 / s)


def printed_condition() -> tuple[float, float]:
    """Condition number of the printed M (eq. 9), and the cosine between its rows for x and z."""
    values = np.linalg.svd(PRINTED_M, compute_uv=False)
    x, z = PRINTED_M[0], PRINTED_M[2]
    return float(values[0] / values[-1]), float(x @ z / np.linalg.norm(x) / np.linalg.norm(z))
