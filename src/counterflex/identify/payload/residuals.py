"""Residuals of a flange sensor's readings without a process, with exact derivatives.

Predicted is :func:`counterflex.sensing.flange_sensor.idle_wrench` of the constants at hand. With ``gamma = g - a``,
``A = [alpha]x + [omega]x^2`` in sensor axes: ``f = m (gamma - A c)``, ``moment = c x f - I alpha - omega x I omega``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.geometry import rotation
from counterflex.geometry.rotation import cross, skew
from counterflex.identify.payload.parameters import (
    BIAS,
    COM,
    COMPONENTS,
    DRIFT,
    INERTIA,
    KELVIN,
    MASS,
    OFFSET,
    TURN,
    UNITS,
)
from counterflex.identify.solver.residuals import Residuals
from counterflex.sensing.flange_sensor import tensor
from counterflex.sensing.orientation_basis import degree_of, orientation_basis, orientation_basis_slope

_UNIT = np.stack([tensor(row) for row in np.eye(6)])


@dataclass(frozen=True, eq=False)
class SensorReadings:
    """Readings with no process; see :class:`counterflex.identify.solver.residuals.Residuals`.

    Attributes:
        group: (n,) rows held out together.
        sigma: (n, 6) N, N m.
        w_sensor: (n, 6) N, N m as read.
        R_base_sensor: (n, 3, 3) by the mounting of the cell file.
        R_rest: (n, 3, 3) rotation that the offset goes by, same mounting: R_base_sensor, or the sensor's rotation in
            the body that the hose pack comes from.
        gamma: (n, 3) m/s2: gravity minus acceleration of the sensor's origin, same axes.
        omega: (n, 3) rad/s, same axes.
        alpha: (n, 3) rad/s2, same axes.
        time_s: (n,) since the beginning of the data.
        warmer_k: (n,) K above the reference temperature.
    """

    name: str
    group: Int
    sigma: Float
    w_sensor: Float
    R_base_sensor: Float
    R_rest: Float
    gamma: Float
    omega: Float
    alpha: Float
    time_s: Float
    warmer_k: Float

    components = tuple(f"{c} {u}" for c, u in zip(COMPONENTS, UNITS, strict=True))

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals (n, 6)."""
        turn = rotation.exp(x[TURN])
        gamma, omega, alpha = self.gamma @ turn, self.omega @ turn, self.alpha @ turn
        c, inertia = x[COM], tensor(x[INERTIA])
        force = x[MASS] * (gamma - cross(alpha, c) - cross(omega, cross(omega, c)))
        moment = cross(c, force) - alpha @ inertia - cross(omega, omega @ inertia)
        w = np.concatenate([force, moment], axis=1) + x[BIAS]
        w += self.time_s[:, None] * x[DRIFT] + self.warmer_k[:, None] * x[KELVIN]
        degree = degree_of((len(x) - OFFSET) // 6)
        if degree:
            w += orientation_basis(self.R_rest @ turn, degree) @ x[OFFSET:].reshape(-1, 6)
        out: Float = (self.w_sensor - w) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """Derivative (n, 6, p) of :meth:`evaluate`."""
        n = len(self.group)
        rho = x[TURN]
        turn = rotation.exp(rho)
        gamma, omega, alpha = self.gamma @ turn, self.omega @ turn, self.alpha @ turn
        m, c, inertia = x[MASS], x[COM], tensor(x[INERTIA])
        alpha_x, omega_x, c_x = skew(alpha), skew(omega), skew(c)
        A = alpha_x + omega_x @ omega_x
        specific = gamma - A @ c
        force = m * specific
        out = np.zeros((n, 6, len(x)))
        out[:, :, BIAS] = np.eye(6)
        out[:, :3, MASS] = specific
        out[:, 3:, MASS] = cross(c, specific)
        out[:, :3, COM] = -m * A
        out[:, 3:, COM] = -skew(force) + c_x @ (-m * A)
        right = _right_jacobian(rho)
        d_gamma, d_omega, d_alpha = skew(gamma) @ right, omega_x @ right, alpha_x @ right
        swing = cross(omega, c)
        d_force = m * (d_gamma + c_x @ d_alpha + skew(swing) @ d_omega + omega_x @ c_x @ d_omega)
        spin = omega @ inertia
        out[:, :3, TURN] = d_force
        out[:, 3:, TURN] = c_x @ d_force - inertia @ d_alpha + skew(spin) @ d_omega - omega_x @ inertia @ d_omega
        out[:, :, DRIFT] = self.time_s[:, None, None] * np.eye(6)
        out[:, :, KELVIN] = self.warmer_k[:, None, None] * np.eye(6)
        turning = np.einsum("kij,nj->nik", _UNIT, alpha)
        gyro = np.einsum("nij,kjl,nl->nik", omega_x, _UNIT, omega)
        out[:, 3:, INERTIA] = -turning - gyro
        degree = degree_of((len(x) - OFFSET) // 6)
        if degree:
            R = self.R_rest @ turn
            phi, slope = orientation_basis(R, degree), orientation_basis_slope(R, degree)
            coefficients = x[OFFSET:].reshape(-1, 6)
            out[:, :, TURN] += np.einsum("nkj,ki->nij", slope, coefficients) @ right
            out[:, :, OFFSET:] = np.einsum("nk,ij->nikj", phi, np.eye(6)).reshape(n, 6, -1)
        return -out / self.sigma[:, :, None]

    def subset(self, rows: Bool) -> SensorReadings:
        """The marked rows only."""
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            w_sensor=self.w_sensor[rows],
            R_base_sensor=self.R_base_sensor[rows],
            R_rest=self.R_rest[rows],
            gamma=self.gamma[rows],
            omega=self.omega[rows],
            alpha=self.alpha[rows],
            time_s=self.time_s[rows],
            warmer_k=self.warmer_k[rows],
        )


def force_error(block: Residuals, x: Float) -> Float:
    """(n,) N, length of the force that is left."""
    out: Float = np.linalg.norm((block.evaluate(x) * block.sigma)[:, :3], axis=1)
    return out


def moment_error(block: Residuals, x: Float) -> Float:
    """(n,) N m, length of the moment that is left."""
    out: Float = np.linalg.norm((block.evaluate(x) * block.sigma)[:, 3:], axis=1)
    return out


def _right_jacobian(rho: Float) -> Float:
    """``Exp(rho + d) = Exp(rho) Exp(J d)``."""
    t = float(np.linalg.norm(rho))
    K = skew(rho)
    if t < 1e-4:
        return np.eye(3) - 0.5 * K + K @ K / 6.0
    out: Float = np.eye(3) - (1.0 - np.cos(t)) / t**2 * K + (t - np.sin(t)) / t**3 * (K @ K)
    return out
