"""Parameters and residuals of an instrumented holder: ``s = bias + kelvin dT + drift t + S [f; p x f]``, linear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.errors import InputError
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.jackknife import added, considered, parts_of_groups, with_jackknife
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.sensing.strain_holder import StrainHolder, force_matrix, lever, tool_matrix

DRAWING_SHARE = 0.6
"""Standard deviation of a sensitivity computed from the drawing, by the root mean square of its kind. Two cheeks and a
rigid ring differ from a frame of beams by up to 0.65 of it (forces across the cheeks)."""
_ZERO, _KELVIN, _DRIFT = 100e-6, 0.2e-6, 1e-9
SAME_POINT_M = 1e-3
"""Loads that act nearer to each other act on one point."""
_AXES = ("fx", "fy", "fz", "mx", "my", "mz")


def sizes(holder: StrainHolder) -> Float:
    """(6,) root mean square of the sensitivities to forces and to moments."""
    S = holder.sensitivity
    return np.repeat([float(np.sqrt(np.mean(S[:, :3] ** 2))), float(np.sqrt(np.mean(S[:, 3:] ** 2)))], 3)


def parameters(holder: StrainHolder, share: float, *, temperature: bool, drift: bool) -> Parameters:
    """The parameters around what the cell file says.

    ``share``: Standard deviation of the sensitivities, see :data:`DRAWING_SHARE`. ``drift``: A drift of each zero is
    free; it is not kept.
    """
    spread = share * sizes(holder)
    n = len(holder.gauges)
    items = [
        Parameter(
            f"bridge{i + 1}.{axis}",
            "1/N" if k < 3 else "1/(N m)",
            float(holder.sensitivity[i, k]),
            float(spread[k]),
            label=f"bridge {i + 1} to {axis}",
        )
        for i in range(n)
        for k, axis in enumerate(_AXES)
    ]
    items += [Parameter(f"bridge{i + 1}.zero", "1", float(holder.bias[i]), _ZERO) for i in range(n)]
    items += [
        Parameter(f"bridge{i + 1}.kelvin", "1/K", float(holder.per_kelvin[i]), _KELVIN, free=temperature)
        for i in range(n)
    ]
    items += [Parameter(f"bridge{i + 1}.drift", "1/s", 0.0, _DRIFT, free=drift) for i in range(n)]
    return Parameters.of(items)


def needed(n: int) -> tuple[str, ...]:
    """Names of what any use has to find first: the zeros of n bridges and their drift."""
    return tuple(f"bridge{i + 1}.{what}" for what in ("zero", "kelvin", "drift") for i in range(n))


def sensitivity_of(x: Float, n: int) -> Float:
    """(n, 6) of the values (p,)."""
    return x[: 6 * n].reshape(n, 6)


@dataclass(frozen=True, eq=False)
class HolderReadings:
    """Bridges under known loads; see :class:`counterflex.identify.solver.residuals.Residuals`."""

    name: str
    group: Int  # (m,) rows held out together
    sigma: Float  # (m, n) of the strains, noise of the force included
    strain: Float
    force: Float  # (m, 3) N on the tool, holder axes
    p_holder_load: Float  # (m, 3) m
    warmer_k: Float  # (m,) K above the reference temperature
    time_s: Float  # (m,) since the beginning
    p_sigma: Float  # (m, 3) m, standard deviation of `p_holder_load`: of a point, the same for all loads on it

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the bridges."""
        return tuple(f"bridge {i + 1}" for i in range(self.strain.shape[1]))

    def _load(self) -> Float:
        return np.concatenate([self.force, np.cross(self.p_holder_load, self.force)], axis=1)

    def unloaded(self, x: Float) -> Float:
        """(m, n) strain that no load causes."""
        n = self.strain.shape[1]
        zero, kelvin, drift = x[6 * n : 7 * n], x[7 * n : 8 * n], x[8 * n :]
        return zero + self.warmer_k[:, None] * kelvin + self.time_s[:, None] * drift

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals (m, n)."""
        S = sensitivity_of(x, self.strain.shape[1])
        out: Float = (self.strain - self.unloaded(x) - self._load() @ S.T) / self.sigma
        return out

    def jacobian(self, x: Float) -> Float:
        """Derivative (m, n, p) of :meth:`evaluate`."""
        m, n = self.strain.shape
        one = np.eye(n)
        parts = [
            np.einsum("mk,ij->mijk", self._load(), one).reshape(m, n, 6 * n),
            np.broadcast_to(one, (m, n, n)),
            self.warmer_k[:, None, None] * one,
            self.time_s[:, None, None] * one,
        ]
        out: Float = -np.concatenate(parts, axis=2)[:, :, : len(x)] / self.sigma[:, :, None]
        return out

    def subset(self, rows: Bool) -> HolderReadings:
        """The marked rows only."""
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            strain=self.strain[rows],
            force=self.force[rows],
            p_holder_load=self.p_holder_load[rows],
            warmer_k=self.warmer_k[rows],
            time_s=self.time_s[rows],
            p_sigma=self.p_sigma[rows],
        )

    def misplaced_by(self, x: Float, points: Float) -> Float:
        """(m, n, 3 k) strain by one standard deviation of where each of the points (k, 3) m truly is."""
        n = self.strain.shape[1]
        S, out = sensitivity_of(x, n), np.zeros((len(self.force), n, 3 * len(points)))
        for k, p in enumerate(points):
            # All loads on one point share its error: it does not average out with their number.
            mine = np.all(np.abs(self.p_holder_load - p) < SAME_POINT_M, axis=1)
            for axis in range(3):
                moment = np.cross(self.p_sigma[mine, axis, None] * np.eye(3)[axis], self.force[mine])
                out[mine, :, 3 * k + axis] = moment @ S[:, 3:].T
        return out

    def estimated(self, x: Float) -> Float:
        """(m, 3) N, force by generalised least squares with the sensitivities x, for each row's own tool tip."""
        S = sensitivity_of(x, self.strain.shape[1])
        noise = np.diag(np.mean(self.sigma**2, axis=0))
        s = self.strain - self.unloaded(x)
        out = np.empty((len(s), 3))
        points, which = np.unique(np.round(self.p_holder_load, 5), axis=0, return_inverse=True)
        for k, p in enumerate(points):
            mine = which.reshape(-1) == k
            out[mine] = s[mine] @ force_matrix(tool_matrix(S, p), noise).T
        return out


def force_error(block: HolderReadings, x: Float) -> Float:
    """(m,) N, length of the error of the estimated force."""
    out: Float = np.linalg.norm(block.estimated(x) - block.force, axis=1)
    return out


def readings(data: Dataset, holder: StrainHolder, *, reference_c: float) -> HolderReadings:
    """Residuals of one dataset of kind ``holder_loads``.

    ``data``: Channels ``strain``, ``f_tcp_holder``; ``p_holder_load`` (else the tool tip of the cell),
    ``temperature_c`` and ``time_s`` where present. ``holder``: Before: its sensitivities carry the noise of the force
    over to strain.

    Raises:
        FileFormatError: A channel is missing or holds values that are not numbers.
        InputError: Another number of bridges than the cell has.
    """
    m = len(data)
    strain, force = data.finite("strain"), data.finite("f_tcp_holder")
    if strain.shape[1] != len(holder.gauges):
        raise InputError(
            "the data have another number of bridges than the cell",
            where=data.where or data.name,
            value=strain.shape[1],
            limit=len(holder.gauges),
        )
    place = (
        data.finite("p_holder_load")
        if data.has("p_holder_load")
        else np.broadcast_to(holder.p_holder_tcp, (m, 3)).copy()
    )
    warmer = data.finite("temperature_c")[:, 0] - reference_c if data.has("temperature_c") else np.zeros(m)
    time_s = data.finite("time_s")[:, 0] if data.has("time_s") else np.zeros(m)
    carried = (
        np.abs(holder.sensitivity @ lever(place)) ** 2 @ (data.channel("f_tcp_holder").need_sigma() ** 2)[:, :, None]
    )
    sigma = np.sqrt(data.channel("strain").need_sigma() ** 2 + carried[:, :, 0])
    time_s = time_s - (float(np.min(time_s)) if m else 0.0)
    p_sigma = np.zeros((m, 3))
    if data.has("p_holder_load") and (stated := data.channel("p_holder_load").sigma) is not None:
        p_sigma = np.broadcast_to(stated, (m, 3)).copy()
    return HolderReadings(data.name, data.group, sigma, strain, force, place, warmer, time_s, p_sigma)


def with_honest_sigma(fit: Fit, blocks: Sequence[HolderReadings]) -> Fit:
    """The fit with standard deviations that hold for what the linear model lacks.

    Not below those of the jackknife over loads (hysteresis, warming, bending); and where each point truly is that loads
    act on, which all loads there have in common (:mod:`counterflex.identify.solver.jackknife`).
    """
    wide = with_jackknife(fit, blocks, parts_of_groups(blocks))
    every = np.concatenate([b.p_holder_load for b in blocks])
    points = np.unique(np.round(every / SAME_POINT_M), axis=0) * SAME_POINT_M
    return added(wide, considered(fit, blocks, [b.misplaced_by(fit.values, points) for b in blocks]))
