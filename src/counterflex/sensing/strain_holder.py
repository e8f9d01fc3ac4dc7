"""The instrumented spindle holder: from the strain of its bridges to the force at the tool (Denkena2015 section 4).

``s = bias + kelvin (T - T_ref) + S w`` with ``w = G(p) f`` the load about the holder's origin of a force at the tool
tip p, ``G = [1; [p]x]``. So one (n, 6) matrix S serves every tool: the matrix of a new tool length or direction follows
from the lever, not from a new calibration. The other way, ``f = M s`` (eq. 8), with

    M = (K^T N^-1 K + P^-1)^-1 K^T N^-1,  K = S G(p)

the generalised least-squares estimate for noise covariance N, and with the prior covariance P of the force its
regularised form (ridge regression).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive, frozen
from counterflex.core.errors import InputError
from counterflex.geometry import pose
from counterflex.geometry.rotation import skew

# The Wheatstone full bridge: its voltage from four strains, and the strain behind a voltage. Four gauges R1 to R4
# around a square, supply across one diagonal, signal across the other. R1 and R3 lie along the strain, R2 and R4 across
# it (Denkena2015 fig. 4): ``U / U_s = R1 / (R1 + R2) - R4 / (R3 + R4)`` with ``R_i = R (1 + k eps_i)``; to first order
# ``k (eps1 - eps2 + eps3 - eps4) / 4``, in which equal thermal strain cancels.

SUPPLY_V = 5.0
GAUGE_FACTOR = 2.0


def strain_of_voltage(
    voltage_v: Float,
    *,
    poisson_ratio: float = 0.3,
    gauge_factor: float = GAUGE_FACTOR,
    supply_v: float = SUPPLY_V,
) -> Float:
    """Strain of a bar in tension that gives this signal: ``2 U / (U_s k (1 + nu))``.

    ``voltage_v``: (...) V. ``poisson_ratio``: Of the body: what the gauges across it see. Returns (...) dimensionless.
    Off by less than 1e-3 of itself below 1000 um/m.
    """
    out: Float = 2.0 * np.asarray(voltage_v, dtype=np.float64) / (supply_v * gauge_factor * (1.0 + poisson_ratio))
    return out


# Closed-form model of a two-cheek spindle holder: the strain under each gauge for any load. Two prismatic
# Euler-Bernoulli cheeks, clamped at z = 0, joined at z = L by a rigid ring that carries the spindle. Holder frame: z
# along the cheeks to the spindle, x through both cheeks, y across them. With the tip flexibility of a cantilever the
# ring's six displacements follow from ``sum A^T k A``, and from them section forces and surface strain
#
# eps_z = N / EA + Mx y / EIx - My x / EIy,  gamma = 1.5 V / (G A) (1 - r^2) + torsion
#
# A full bridge of two gauges at the angle a to z and two across it, scaled to show the strain of a bar under tension,
# reads ``eps_z cos 2a + gamma sin 2a / (1 + nu)``. It serves as what is known before a calibration, and to choose
# places for gauges; a calibration corrects it.

_NEAR = 0.5e-3  # m, within which a gauge counts as on a surface


@dataclass(frozen=True)
class Gauge:
    """One full bridge."""

    p_holder_gauge: tuple[float, float, float]  # x, y, z m in the holder frame, on a surface of a cheek
    angle_rad: float = 0.0  # of the active gauges to z, towards y on faces across x, towards x on edges across y
    factor: float = 1.0  # by which the notch raises the strain


@dataclass(frozen=True)
class HolderBeam:
    """Dimensions of the holder."""

    length_m: float  # L, from the clamped end to the ring
    distance_m: float  # between the middles of the cheeks, along x
    thickness_m: float  # of a cheek, along x
    width_m: float  # of a cheek, along y
    e_pa: float = 210e9
    poisson_ratio: float = 0.3

    def __post_init__(self) -> None:
        """Check that the dimensions are those of a holder. Raises InputError: not positive, or cheeks that meet."""
        for name in ("length_m", "distance_m", "thickness_m", "width_m", "e_pa"):
            as_positive(f"holder: {name}", getattr(self, name))
        if self.thickness_m >= self.distance_m:
            raise InputError("the cheeks of the holder overlap", value=self.thickness_m, limit=f"< {self.distance_m}")

    def sensitivity(self, gauges: Sequence[Gauge]) -> Float:
        """Strain shown per unit of load.

        Returns (n, 6) 1/N and 1/(N m): strain per force and moment about the holder's origin in its axes. Raises
        InputError: a gauge sits on no surface of a cheek.
        """
        return np.stack([self._gauge(g) for g in gauges]) if gauges else np.zeros((0, 6))

    def tip_stiffness(self) -> Float:
        """(6, 6) stiffness of one cheek at its tip."""
        L, e, t, b = self.length_m, self.e_pa, self.thickness_m, self.width_m
        area, ix, iy = t * b, t * b**3 / 12.0, b * t**3 / 12.0
        c = np.zeros((6, 6))
        c[0, 0], c[0, 4], c[4, 4] = L**3 / (3 * e * iy), L**2 / (2 * e * iy), L / (e * iy)
        c[1, 1], c[1, 3], c[3, 3] = L**3 / (3 * e * ix), -(L**2) / (2 * e * ix), L / (e * ix)
        c[4, 0], c[3, 1] = c[0, 4], c[1, 3]
        c[2, 2], c[5, 5] = L / (e * area), L / (self._g * self._torsion)
        return np.asarray(np.linalg.inv(c), dtype=np.float64)

    @property
    def _g(self) -> float:
        return self.e_pa / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def _torsion(self) -> float:
        t, b = sorted((self.thickness_m, self.width_m))
        return b * t**3 * (1.0 / 3.0 - 0.21 * t / b * (1.0 - t**4 / (12.0 * b**4)))

    def tip_loads(self) -> tuple[Float, Float]:
        """Loads on the tips of the cheeks at -x and +x per unit load about the holder's origin: two (6, 6)."""
        k = self.tip_stiffness()
        maps = []
        for side in (-0.5, 0.5):
            A = np.eye(6)
            A[:3, 3:] = -skew(np.array([side * self.distance_m, 0.0, 0.0]))
            maps.append(A)
        ring = np.linalg.inv(sum(A.T @ k @ A for A in maps))
        at_ring = np.stack([pose.shift_wrench(w, np.array([0.0, 0.0, -self.length_m])) for w in np.eye(6)], axis=1)
        low, right = (k @ A @ ring @ at_ring for A in maps)
        return low, right

    def _gauge(self, gauge: Gauge) -> Float:
        x, y, z = as_float("place of a gauge", gauge.p_holder_gauge, (3,))
        side = 1 if x > 0.0 else 0
        x = float(x) - (side - 0.5) * self.distance_m
        t, b = self.thickness_m, self.width_m
        face = abs(abs(x) - 0.5 * t) < _NEAR and abs(y) <= 0.5 * b + _NEAR
        edge = abs(abs(y) - 0.5 * b) < _NEAR and abs(x) <= 0.5 * t + _NEAR
        if not (face or edge) or not -_NEAR <= z <= self.length_m + _NEAR:
            raise InputError(
                "a gauge sits on no surface of a cheek",
                value=[round(1e3 * v, 2) for v in gauge.p_holder_gauge],
                limit=f"|x| = {500 * (self.distance_m - t):g} or {500 * (self.distance_m + t):g} mm, or |y| = "
                f"{500 * b:g} mm; z 0..{1e3 * self.length_m:g} mm",
            )
        tip = self.tip_loads()[side]
        lever = self.length_m - float(z)
        mx, my = tip[3] - lever * tip[1], tip[4] + lever * tip[0]
        area = t * b
        eps = tip[2] / area + mx * y / (t * b**3 / 12.0) - my * x / (b * t**3 / 12.0)
        twist = tip[5] * min(t, b) / self._torsion
        if face:
            shear = 1.5 * tip[1] / area * (1.0 - (2.0 * y / b) ** 2) + twist * np.sign(x)
        else:
            shear = 1.5 * tip[0] / area * (1.0 - (2.0 * x / t) ** 2) - 0.75 * twist * np.sign(y)
        a = 2.0 * gauge.angle_rad
        out: Float = gauge.factor * (
            eps / self.e_pa * math.cos(a) + shear / self._g * math.sin(a) / (1.0 + self.poisson_ratio)
        )
        return out


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
    """Constants of an instrumented holder."""

    beam: HolderBeam
    gauges: tuple[Gauge, ...]
    p_holder_tcp: Float  # (3,) m, tool tip in the holder frame
    sensitivity: Float  # (n, 6) 1/N, 1/(N m); see sensitivity
    bias: Float  # (n,) strain with no load at the reference temperature
    per_kelvin: Float  # (n,) 1/K, what is left of temperature after the bridges' own compensation
    noise: Float  # (n,) standard deviation of a sample's strain
    reference_c: float = 20.0  # reference temperature, deg C
    segment: str = field(default="")  # body of the end effector whose frame is the holder's, where one is named

    def __post_init__(self) -> None:
        """Check shapes. Raises InputError: a wrong shape, fewer than three bridges, or noise that is not positive."""
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
    """Sight of the bridges on a force."""

    sigma_n: Float  # (3,) N standard deviation of each component of the estimated force for one sample
    condition: float  # largest by smallest singular value of the whitened K
    directions: Float  # (3, 3) rows: unit force directions from best to worst seen
    direction_sigma_n: Float  # (3,) N standard deviation along each


def sight(K: Float, noise_covariance: Float) -> Sight:
    """Force directions that bridges see, and how well.

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
