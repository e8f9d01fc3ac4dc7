"""Residuals of a flange sensor's readings without a process, with exact derivatives.

Predicted is :func:`counterflex.sensing.wrench_kernel.idle` of the constants at hand, in motion. With ``gamma = g - a``,
``A = [alpha]x + [omega]x^2`` in sensor axes: ``f = m (gamma - A c)``, ``moment = c x f - I alpha - omega x I omega``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.units import DEG, MINUTE
from counterflex.geometry import rotation
from counterflex.geometry.rotation import cross, skew
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.sensing import flange_sensor

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
UNITS = ("N", "N", "N", "N m", "N m", "N m")
BIAS, MASS, COM, TURN = slice(0, 6), 6, slice(7, 10), slice(10, 13)
DRIFT, KELVIN, INERTIA, OFFSET = slice(13, 19), slice(19, 25), slice(25, 31), 31
_ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")
_HOUR = 60.0 * MINUTE


@dataclass(frozen=True)
class Knowledge:
    """Prior knowledge: one standard deviation each."""

    bias_n: float = 500.0  # force with no load
    bias_nm: float = 100.0  # moment with no load
    mass_share: float = 0.5  # of the mass in the cell file, relative
    mass_kg: float = 20.0  # where the cell file has less than this, it is the standard deviation itself
    com_m: float = 0.15  # centre of gravity, per axis
    turn_rad: float = 2.0 * DEG  # mounting rotation, per axis
    drift_n_per_h: float = 10.0  # drift of the forces
    drift_nm_per_h: float = 2.0  # of the moments
    kelvin_n: float = 2.0  # temperature coefficient of the forces, N/K
    kelvin_nm: float = 0.5  # of the moments, N m/K
    offset_n: float = 3.0  # size of the orientation-dependent offset of a force, root mean square per function
    offset_nm: float = 1.0  # of a moment
    inertia_kg_m2: float = 5.0  # moments of inertia


@dataclass(frozen=True)
class SensorEffects:
    """Effects that the data can tell apart from the rest."""

    degree: int = 0  # of the orientation-dependent offset, 0 to 2
    drift: bool = False  # the data span time
    temperature: bool = False  # the data span temperatures
    inertia: bool = False  # the data have motion


def parameters(sensor: flange_sensor.FlangeSensor, known: Knowledge, effects: SensorEffects) -> Parameters:
    """The parameters around what the cell file says.

    The offset has nominal 0 and its size as prior, so that bias, weight and mounting explain what they can.

    ``effects``: What is free; the rest is held at what the cell file says.
    """
    spread = max(known.mass_share * sensor.mass_kg, known.mass_kg)
    items = _six("bias", "", sensor.w_bias, known.bias_n, known.bias_nm)
    items.append(Parameter("mass", "kg", sensor.mass_kg, spread, label="mass behind the sensor"))
    items += [
        Parameter(f"com.{a}", "m", float(v), known.com_m, label=f"centre of gravity {a}")
        for a, v in zip("xyz", sensor.p_sensor_com, strict=True)
    ]
    items += [Parameter(f"mounting.{a}", "rad", 0.0, known.turn_rad, label=f"mounting about {a}") for a in "xyz"]
    force, moment = known.drift_n_per_h / _HOUR, known.drift_nm_per_h / _HOUR
    items += _six("drift", "/s", sensor.w_drift_per_s, force, moment, free=effects.drift)
    items += _six("temperature", "/K", sensor.w_kelvin, known.kelvin_n, known.kelvin_nm, free=effects.temperature)
    items += [
        Parameter(f"inertia.{e}", "kg m2", float(v), known.inertia_kg_m2, free=effects.inertia, label=f"inertia {e}")
        for e, v in zip(_ENTRIES, sensor.inertia_kg_m2, strict=True)
    ]
    for k in range(flange_sensor.COUNTS[effects.degree]):
        items += _six(f"offset{k + 1}", "", np.zeros(6), known.offset_n, known.offset_nm, label=f"offset {k + 1}")
    return Parameters.of(items)


def _six(
    stem: str, unit: str, nominal: Float, force: float, moment: float, *, label: str = "", free: bool = True
) -> list[Parameter]:
    """Six components of a wrench as parameters; ``force`` and ``moment`` are their priors."""
    return [
        Parameter(
            f"{stem}.{c}", u + unit, float(value), force if i < 3 else moment, free=free, label=f"{label or stem} {c}"
        )
        for i, (c, u, value) in enumerate(zip(COMPONENTS, UNITS, nominal, strict=True))
    ]


def sensor_of(sensor: flange_sensor.FlangeSensor, x: Float, reference_c: float) -> flange_sensor.FlangeSensor:
    """The sensor with found values.

    ``sensor``: Of the cell before: body and frame; and where the hose pack was taken to come from. ``x``: (p,) SI
    values in the order of :func:`parameters`.
    """
    return flange_sensor.FlangeSensor(
        segment=sensor.segment,
        T_seg_sensor=flange_sensor.turned(sensor.T_seg_sensor, x[TURN]),
        mass_kg=float(x[MASS]),
        p_sensor_com=x[COM],
        w_bias=x[BIAS],
        w_drift_per_s=x[DRIFT],
        w_kelvin=x[KELVIN],
        reference_c=reference_c,
        w_offset=x[OFFSET:].reshape(-1, 6),
        inertia_kg_m2=x[INERTIA],
        hose_from=sensor.hose_from if len(x) > OFFSET else "",
    )


def needed() -> tuple[str, ...]:
    """Names of what any use of the sensor has to find first: its zero."""
    return tuple(f"bias.{c}" for c in COMPONENTS)


def seg_frame_com(sensor: flange_sensor.FlangeSensor, fit: Fit) -> Float:
    """(3,) m, centre of gravity found, in the frame of the body that carries the sensor."""
    T = sensor.T_seg_sensor
    out: Float = T[:3, 3] + T[:3, :3] @ rotation.exp(fit.values[TURN]) @ fit.values[COM]
    return out


_UNIT = np.stack([flange_sensor.tensor(row) for row in np.eye(6)])


@dataclass(frozen=True, eq=False)
class SensorReadings:
    """Readings with no process; see :class:`counterflex.identify.solver.residuals.Residuals`."""

    name: str
    group: Int  # (n,) rows held out together
    sigma: Float  # (n, 6) N, N m
    w_sensor: Float  # (n, 6) N, N m as read
    R_base_sensor: Float  # (n, 3, 3) by the mounting of the cell file
    # (n, 3, 3) rotation that the offset goes by, same mounting: R_base_sensor, or the sensor's rotation in the body
    # that the hose pack comes from
    R_rest: Float
    gamma: Float  # (n, 3) m/s2: gravity minus acceleration of the sensor's origin, same axes
    omega: Float  # (n, 3) rad/s, same axes
    alpha: Float  # (n, 3) rad/s2, same axes
    time_s: Float  # (n,) since the beginning of the data
    warmer_k: Float  # (n,) K above the reference temperature

    components = tuple(f"{c} {u}" for c, u in zip(COMPONENTS, UNITS, strict=True))

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals (n, 6)."""
        turn = rotation.exp(x[TURN])
        gamma, omega, alpha = self.gamma @ turn, self.omega @ turn, self.alpha @ turn
        c, inertia = x[COM], flange_sensor.tensor(x[INERTIA])
        force = x[MASS] * (gamma - cross(alpha, c) - cross(omega, cross(omega, c)))
        # The inertia is about the centre of gravity, the moment about the sensor's origin: the lever carries the rest.
        moment = cross(c, force) - alpha @ inertia - cross(omega, omega @ inertia)
        w = np.concatenate([force, moment], axis=1) + x[BIAS]
        w += self.time_s[:, None] * x[DRIFT] + self.warmer_k[:, None] * x[KELVIN]
        degree = flange_sensor.degree_of((len(x) - OFFSET) // 6)
        if degree:
            w += flange_sensor.orientation_basis(self.R_rest @ turn, degree) @ x[OFFSET:].reshape(-1, 6)
        out: Float = (self.w_sensor - w) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """Derivative (n, 6, p) of :meth:`evaluate`."""
        n = len(self.group)
        rho = x[TURN]
        turn = rotation.exp(rho)
        gamma, omega, alpha = self.gamma @ turn, self.omega @ turn, self.alpha @ turn
        m, c, inertia = x[MASS], x[COM], flange_sensor.tensor(x[INERTIA])
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
        degree = flange_sensor.degree_of((len(x) - OFFSET) // 6)
        if degree:
            R = self.R_rest @ turn
            phi, slope = flange_sensor.orientation_basis(R, degree), flange_sensor.orientation_basis_slope(R, degree)
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
