"""A measured frequency response of the tool tip, and the modes that describe it.

The modes of a direction are found one after another: each begins at the largest imaginary part that is still
unexplained, then the poles of all are fitted together (Gauss-Newton on frequencies and damping ratios, the residues in
the least-squares sense and not negative), until the rest is small or a
further mode explains little of it.

Source: Ewins 2000, Modal Testing, ch. 4 (curve fitting of driving-point responses).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Complex, Float, as_float
from counterflex.core.errors import InputError
from counterflex.cutting.stability.modes import DIMENSIONS, TipModes

MOST_MODES: Final = 6
GOOD: Final = 0.02
"""Unexplained share of a response, root mean square, at which no further mode is looked for."""
_WORTH: Final = 0.8
"""A further mode must leave less than this share of what was unexplained (squared)."""
_DAMPING = (1e-3, 0.5)


@dataclass(frozen=True, eq=False)
class Response:
    """Frequency response at the tool tip.

    Raises:
        InputError: Shapes do not match, or the frequencies do not rise.
    """

    omega_rad_s: Float  # (n,) angular frequencies, rising
    # (n, 3, 3) displacement over force, m/N, in the TCP frame; imaginary part negative at a resonance
    receptance: Complex

    def __post_init__(self) -> None:
        """Check shapes and order."""
        omega = as_float("omega_rad_s", self.omega_rad_s, (None,))
        if self.receptance.shape != (len(omega), DIMENSIONS, DIMENSIONS):
            raise InputError("the response has the wrong shape", value=self.receptance.shape, limit=(len(omega), 3, 3))
        if len(omega) < 2 or omega[0] < 0.0 or np.any(np.diff(omega) <= 0.0):
            raise InputError("frequencies of the response do not rise", limit="at least 2, rising")

    def turned(self, R: Float) -> Response:
        """The same in other axes: ``R`` (3, 3) takes vectors of the present frame to the new one."""
        return Response(self.omega_rad_s, R @ self.receptance @ R.T)


def fitted_modes(response: Response) -> tuple[TipModes, float]:
    """Modes of a response, each along one axis of its frame, and the share that they leave unexplained (rms).

    Cross responses between the axes are left out.

    Args:
        response: Driving-point responses on the diagonal; a zero one is rigid.

    Raises:
        InputError: No direction has a response.
    """
    omega, zeta, shape, rest, whole = [], [], [], 0.0, 0.0
    for axis in range(DIMENSIONS):
        g = response.receptance[:, axis, axis]
        if not np.any(g != 0.0):
            continue
        poles, residues, left = _fit(response.omega_rad_s, g)
        for (w, z), c in zip(poles, residues, strict=True):
            if c > 0.0:
                omega.append(w)
                zeta.append(z)
                shape.append(np.sqrt(c) * np.eye(DIMENSIONS)[axis])
        rest, whole = rest + left, whole + float(np.sum(np.abs(g) ** 2))
    if not omega:
        raise InputError("the response of the tool tip has no mode", limit="a resonance in at least one direction")
    order = np.argsort(omega)
    modes = TipModes(np.array(omega)[order], np.array(zeta)[order], np.array(shape)[order].T)
    return modes, float(np.sqrt(rest / whole))


def _fit(omega: Float, g: Complex) -> tuple[Float, Float, float]:
    """Poles (m, 2) as frequency and ratio, residues (m,) and the squared rest of one direction."""
    size = float(np.sqrt(np.sum(np.abs(g) ** 2)))
    poles, best = np.empty((0, 2)), (np.empty((0, 2)), np.empty(0), size**2)
    left = g
    for _ in range(MOST_MODES):
        at = int(np.argmin(left.imag))
        if left.imag[at] >= 0.0:
            break
        # The first frequency may be 0, whose logarithm is none: a response that falls from there begins at the next.
        poles = np.vstack([poles, [max(omega[at], omega[1]), 0.03]])
        low = np.tile([np.log(0.5 * max(omega[0], 1e-3 * omega[-1])), np.log(_DAMPING[0])], len(poles))
        high = np.tile([np.log(1.5 * omega[-1]), np.log(_DAMPING[1])], len(poles))
        begin = np.clip(np.log(poles).ravel(), low + 1e-9, high - 1e-9)
        estimate = scipy.optimize.least_squares(
            lambda x: _stack(_rest(omega, g, np.exp(x.reshape(-1, 2)))[1]) / size,
            begin,
            bounds=(low, high),
            x_scale=0.01,
            max_nfev=60,
        )
        poles = np.exp(estimate.x.reshape(-1, 2))
        residues, left = _rest(omega, g, poles)
        squared = float(np.sum(np.abs(left) ** 2))
        if squared > _WORTH * best[2]:
            break
        best = (poles, residues, squared)
        if squared < (GOOD * size) ** 2:
            break
    return best


def _rest(omega: Float, g: Complex, poles: Float) -> tuple[Float, Complex]:
    w, z = poles.T
    basis = 1.0 / (w**2 - omega[:, None] ** 2 + 2.0j * z * w * omega[:, None])
    size = np.abs(basis).max(axis=0)
    # At a driving point residues are squares of shapes. A negative one would be a mode that gives energy away.
    residues = scipy.optimize.nnls(np.concatenate([basis.real, basis.imag]) / size, _stack(g))[0] / size
    return residues, g - basis @ residues


def _stack(values: Complex) -> Float:
    out: Float = np.concatenate([values.real, values.imag])
    return out
