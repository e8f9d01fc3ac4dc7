"""Residuals of one slow reversal motion of one axis: by encoders on the link, or by a tracker on the tool.

With x the motor angle less its mean and l the lost motion ``s - c T`` of :mod:`counterflex.robot.elasticity.play`:

* encoders: ``q_link - q_motor = a0 (+ a1 x) + l (+ c (T - mean T))``; the part in brackets on the right belongs to
  large motions, a1 to small ones, where elastic torsion cannot be told from an error of the encoders' pitch;
* tracker: ``p = a0 + a1 (x + l) + a2 x^2`` along the direction in which the tool moves; lever, sag and curvature are in
  a0, a1, a2, so neither the tracker's frame nor the lever needs to be known.

What the channel shows is late by a delay: ``u(t - delay) = u - delay du/dt``. The constants a of each motion are
eliminated by projection; the derivative of that projection is exact.

Source: variable projection: Golub and Pereyra 1973.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.core.jit import kernel
from counterflex.core.units import MRAD
from counterflex.robot.elasticity.play import FLOATING_NM, settle_axis

# Torsion of one axis along a path with play and dry friction, and its derivatives by all constants.
# The model is that of :mod:`counterflex.robot.elasticity.play`. Where the torsion s balances the axis,
# ``T + sum clip(f_e - F_e/d_e (moved + s)) - spring(s) = 0``, the derivative follows from the same equation: springs
# and sticking elements yield, slipping ones hold their limit; so it is carried from point to point with the state.


@kernel(
    "void(float64[::1], float64[::1], float64, float64, float64[::1], float64[::1], float64[::1], float64[:, ::1])",
    entry=True,
)
def follow_with_slopes(
    q: Float,
    torque: Float,
    compliance: float,
    half_band: float,
    limit: Float,
    slip: Float,
    torsion: Float,
    slope: Float,
) -> None:
    """Torsion and its derivatives by ``c, b, F_1 ... F_m, d_1 ... d_m``, from relaxed elements at the first point.

    Args:
        q: (n,) rad, motor angles in order.
        torque: (n,) N m.
        compliance: c > 0, rad/(N m).
        half_band: b, rad.
        limit: (m,) F > 0, N m.
        slip: (m,) d > 0, rad.
        torsion: (n,) rad, written.
        slope: (n, 2 + 2 m), written.
    """
    m = limit.shape[0]
    p = 2 + 2 * m
    force = np.zeros(m)
    d_force = np.zeros((m, p))
    ds = np.zeros(p)
    d_link = np.zeros(p)
    num = np.zeros(p)
    # The history before the first row is not known: a loaded axis leans on its flank, a floating one in between.
    lean = min(max(torque[0] / FLOATING_NM, -1.0), 1.0)
    s = compliance * torque[0] + lean * half_band
    ds[0], ds[1] = torque[0], lean
    link = q[0] + s
    d_link[:] = ds
    torsion[0] = s
    slope[0, :] = ds
    for n in range(1, q.shape[0]):
        moved = q[n] - link
        s = settle_axis(moved, torque[n], s, compliance, half_band, limit, slip, force)
        den = 0.0
        num[:] = 0.0
        if s > half_band:
            den += 1.0 / compliance
            num[0] += (s - half_band) / compliance**2
            num[1] += 1.0 / compliance
        elif s < -half_band:
            den += 1.0 / compliance
            num[0] += (s + half_band) / compliance**2
            num[1] -= 1.0 / compliance
        for e in range(m):
            k = limit[e] / slip[e]
            u = force[e] - k * (moved + s)
            if u > limit[e]:
                num[2 + e] += 1.0
            elif u < -limit[e]:
                num[2 + e] -= 1.0
            else:
                den += k
                for i in range(p):
                    num[i] += d_force[e, i] + k * d_link[i]
                num[2 + e] -= (moved + s) / slip[e]
                num[2 + m + e] += limit[e] / slip[e] ** 2 * (moved + s)
        if den > 0.0:
            for i in range(p):
                ds[i] = num[i] / den
        step = moved + s
        for e in range(m):
            k = limit[e] / slip[e]
            u = force[e] - k * step
            if u > limit[e] or u < -limit[e]:
                side = 1.0 if u > 0.0 else -1.0
                force[e] = side * limit[e]
                d_force[e, :] = 0.0
                d_force[e, 2 + e] = side
            else:
                force[e] = u
                for i in range(p):
                    d_force[e, i] -= k * (ds[i] - d_link[i])
                d_force[e, 2 + e] -= step / slip[e]
                d_force[e, 2 + m + e] += limit[e] / slip[e] ** 2 * step
        link = q[n] + s
        d_link[:] = ds
        torsion[n] = s
        slope[n, :] = ds


LARGE_RAD = 50.0 * MRAD
"""Motion beyond which elastic torsion is seen by the encoders."""


@dataclass(frozen=True)
class PlayPlaces:
    """Places of the parameters of an axis: compliance, half band, friction and slip per element, delay or -1."""

    compliance: int
    half_band: int
    friction: tuple[int, ...]
    slip: tuple[int, ...]
    delay: int
    count: int

    @property
    def constants(self) -> tuple[int, ...]:
        """In the order of :func:`counterflex.identify.play.residuals.follow_with_slopes`."""
        return (self.compliance, self.half_band, *self.friction, *self.slip)


@dataclass(frozen=True, eq=False)
class ReversalResiduals:
    """See :class:`counterflex.identify.solver.residuals.Residuals` and the module."""

    name: str  # of the motion
    group: Int  # (n,) its number
    components: tuple[str, ...]  # one, with unit
    sigma: Float  # (n, 1) SI
    axis: int  # 0..5
    by: Literal["encoder", "tracker"]  # `encoder` or `tracker`
    q: Float  # (n,) rad, motor angle
    torque: Float  # (n,) N m about the axis
    time_s: Float | None  # (n,) or None where the axis stood still at each row
    measured: Float  # (n,) rad (encoder, link minus motor) or m (tracker, along the motion)
    places: PlayPlaces  # where the parameters stand

    def lost(self, x: Float) -> tuple[Float, Float]:
        """Lost motion (n,) rad at the parameters and its derivatives (n, k) by the constants of the axis."""
        place = self.places
        n, m = len(self.q), len(place.friction)
        torsion, slope = np.zeros(n), np.zeros((n, 2 + 2 * m))
        follow_with_slopes(
            self.q,
            self.torque,
            float(x[place.compliance]),
            float(x[place.half_band]),
            np.array([x[i] for i in place.friction]),
            np.array([x[i] for i in place.slip]),
            torsion,
            slope,
        )
        slope[:, 0] -= self.torque
        return torsion - x[place.compliance] * self.torque, slope

    @property
    def large(self) -> bool:
        """Return whether elastic torsion is seen."""
        return self.by == "encoder" and len(self.q) > 0 and float(np.ptp(self.q)) > LARGE_RAD

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals (n, 1)."""
        out: Float = self._walk(x, None)
        return out

    def jacobian(self, x: Float) -> Float:
        """(n, 1, p)."""
        J: Float = np.zeros((len(self.q), 1, self.places.count))
        self._walk(x, J)
        return J

    def subset(self, rows: Bool) -> ReversalResiduals:
        """All rows or none: the state of an axis depends on every row before.

        A part of the rows keeps their order, as if the motion had consisted of these.
        """
        return replace(
            self,
            group=self.group[rows],
            sigma=self.sigma[rows],
            q=np.ascontiguousarray(self.q[rows]),
            torque=np.ascontiguousarray(self.torque[rows]),
            time_s=None if self.time_s is None else self.time_s[rows],
            measured=self.measured[rows],
        )

    def shape(self, x: Float) -> tuple[Float, Float]:
        """Angle of the link less that of the motor (n,) rad by the model, and as measured with the rest taken out."""
        if len(self.q) == 0:
            return np.zeros(0), np.zeros(0)
        lost, _ = self.lost(x)
        residual = self._walk(x, None)[:, 0] * self.sigma[:, 0]
        lever = 1.0
        if self.by == "tracker":
            angle = self.q - np.mean(self.q)
            B = np.stack([np.ones(len(angle)), self._shifted(angle + lost, x), angle**2], axis=1)
            lever = float(np.linalg.lstsq(B, self.measured, rcond=None)[0][1])
        return lost, lost + residual / lever

    def _shifted(self, values: Float, x: Float) -> Float:
        if self.places.delay < 0 or self.time_s is None:
            return values
        out: Float = values - x[self.places.delay] * np.gradient(values, self.time_s, axis=0)
        return out

    def _walk(self, x: Float, J: Float | None) -> Float:
        n = len(self.q)
        if n == 0:
            return np.zeros((0, 1))
        sigma = self.sigma[:, 0]
        lost, slope = self.lost(x)
        angle = self.q - np.mean(self.q)
        place = self.places
        late = place.delay >= 0 and self.time_s is not None
        constants = list(place.constants)
        if self.by == "encoder":
            # Over a small motion elastic torsion is a straight line in the angle, as is an error of pitch: neither is
            # believed.
            B = np.ones((n, 1)) if self.large else np.stack([np.ones(n), angle / max(np.ptp(angle), 1e-12)], axis=1)
            model = lost.copy()
            if self.large:
                model += x[place.compliance] * (self.torque - np.mean(self.torque))
                slope = slope.copy()
                slope[:, 0] += self.torque - np.mean(self.torque)
            moved = self.q + model
            rate = np.gradient(moved, self.time_s) if late and self.time_s is not None else np.zeros(n)
            shown = model - (x[place.delay] * rate if late else 0.0)
            Q = np.linalg.qr(B)[0]
            r = self.measured - shown
            r = r - Q @ (Q.T @ r)
            if J is not None:
                D = self._shifted(slope, x)
                J[:, 0, constants] = -(D - Q @ (Q.T @ D)) / sigma[:, None]
                if late:
                    J[:, 0, place.delay] = (rate - Q @ (Q.T @ rate)) / sigma
            return np.asarray((r / sigma)[:, None])
        whole = angle + lost
        B = np.stack([np.ones(n), self._shifted(whole, x), angle**2], axis=1)
        scale = np.maximum(np.linalg.norm(B, axis=0), 1e-300)
        Q, R = np.linalg.qr(B / scale)
        beta = np.linalg.solve(R, Q.T @ self.measured)
        r = self.measured - Q @ (Q.T @ self.measured)
        if J is not None:
            back = Q @ np.linalg.inv(R).T[:, 1]  # column of the pseudo-inverse, transposed
            lever = beta[1] / scale[1]
            D = self._shifted(slope, x)
            J[:, 0, constants] = -(lever * (D - Q @ (Q.T @ D)) + np.outer(back / scale[1], D.T @ r)) / sigma[:, None]
            if late and self.time_s is not None:
                d = -np.gradient(whole, self.time_s)
                J[:, 0, place.delay] = -(lever * (d - Q @ (Q.T @ d)) + back / scale[1] * float(d @ r)) / sigma
        return np.asarray((r / sigma)[:, None])


@dataclass(frozen=True, eq=False)
class AxisResiduals:
    """All motions of one axis as one block; see :class:`counterflex.identify.solver.residuals.Residuals`."""

    parts: tuple[ReversalResiduals, ...]

    @property
    def name(self) -> str:
        """Of the block."""
        return f"reversals of axis {self.parts[0].axis + 1}"

    @property
    def group(self) -> Int:
        """(n,) number of the motion."""
        return np.concatenate([part.group for part in self.parts])

    @property
    def components(self) -> tuple[str, ...]:
        """One."""
        return self.parts[0].components

    @property
    def sigma(self) -> Float:
        """(n, 1) SI."""
        return np.concatenate([part.sigma for part in self.parts])

    def evaluate(self, x: Float) -> Float:
        """(n, 1) weighted residuals."""
        return np.concatenate([part.evaluate(x) for part in self.parts])

    def jacobian(self, x: Float) -> Float:
        """(n, 1, p)."""
        return np.concatenate([part.jacobian(x) for part in self.parts])

    def subset(self, rows: Bool) -> AxisResiduals:
        """The marked rows only."""
        ends = np.cumsum([len(part.q) for part in self.parts])[:-1]
        return AxisResiduals(
            tuple(part.subset(mask) for part, mask in zip(self.parts, np.split(rows, ends), strict=True))
        )

    def angle_error(self, x: Float) -> Float:
        """(n,) rad, size of the error of the link's angle by the model."""
        pairs = [part.shape(x) for part in self.parts]
        return np.concatenate([np.abs(measured - by_model) for by_model, measured in pairs])
