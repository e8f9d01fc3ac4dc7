"""Plant of the tracker's loop: what a tracker sees of a correction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from counterflex.core.arrays import Float, as_positive

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class TrackerPlant:
    """Response of the tracker's deviation to a correction."""

    period_s: float  # t
    delay_s: float  # d
    natural_per_s: float  # w0, rad/s
    damping: float  # z0
    mode_per_s: float = 0.0  # w, rad/s; 0 is a robot without a mode
    mode_damping: float = 0.1  # z
    mode_share: float = 1.0  # m: 1 where the whole tool moves with the mode

    def __post_init__(self) -> None:
        """Check ranges."""
        for name in ("period_s", "natural_per_s", "damping", "mode_damping"):
            as_positive(f"tracker loop: {name}", getattr(self, name))
        for name in ("delay_s", "mode_per_s", "mode_share"):
            as_positive(f"tracker loop: {name}", getattr(self, name), zero=True)

    @property
    def slow_s(self) -> float:
        """Time constant of the slower pole of the lag; of both together where they are complex."""
        if self.damping <= 1.0:
            return 2.0 * self.damping / self.natural_per_s
        return (self.damping + math.sqrt(self.damping**2 - 1.0)) / self.natural_per_s

    def sampled(self) -> tuple[Float, Float, Float]:
        """``x' = A x + B u, y = C x`` (n, n), (n,), (n,) over one cycle, exact, the dead time's cycles in the state."""
        A, B, C = self._continuous()
        T, n = self.period_s, len(B)
        whole = math.floor(self.delay_s / T + 1e-9)
        rest = max(0.0, self.delay_s - whole * T)
        step, _ = _zero_order_hold(A, B, T)
        to_the_end, early_input = _zero_order_hold(A, B, T - rest)
        old = to_the_end @ _zero_order_hold(A, B, rest)[1]  # the input before still acts for ``rest``
        size = n + whole + 1
        out, into, seen = np.zeros((size, size)), np.zeros(size), np.zeros(size)
        out[:n, :n] = step
        # The state after the plant's: inputs of the last cycles, newest first.
        if whole == 0:
            into[:n] = early_input
            out[:n, n] = old
        else:
            out[:n, n + whole - 1] = early_input
            out[:n, n + whole] = old
        into[n] = 1.0
        for k in range(whole):
            out[n + 1 + k, n + k] = 1.0
        seen[:n] = C
        return out, into, seen

    def response(self, frequency_hz: Float) -> Complex:
        """P at ``z = exp(2 pi i f T)``, (k,) complex."""
        A, B, C = self.sampled()
        z = np.exp(2j * np.pi * np.asarray(frequency_hz, dtype=np.float64) * self.period_s)
        system = z[:, None, None] * np.eye(len(B)) - A
        solved = np.linalg.solve(system, np.broadcast_to(B.astype(np.complex128)[:, None], (*z.shape, len(B), 1)))
        out: Complex = solved[..., 0] @ C.astype(np.complex128)
        return out

    def _continuous(self) -> tuple[Float, Float, Float]:
        w0, z0, w, z = self.natural_per_s, self.damping, self.mode_per_s, self.mode_damping
        lag = np.array([[0.0, 1.0], [-w0 * w0, -2.0 * z0 * w0]])
        if w == 0.0 or self.mode_share == 0.0:
            return lag, np.array([0.0, w0 * w0]), np.array([1.0, 0.0])
        A = np.zeros((4, 4))
        A[:2, :2] = lag
        # The mode is shaken by the acceleration of its base: r'' + 2 z w r' + w^2 r = -y''.
        A[2, 3] = 1.0
        A[3] = [w0 * w0, 2.0 * z0 * w0, -w * w, -2.0 * z * w]
        return A, np.array([0.0, w0 * w0, 0.0, -w0 * w0]), np.array([1.0, 0.0, self.mode_share, 0.0])


def _zero_order_hold(A: Float, B: Float, time_s: float) -> tuple[Float, Float]:
    """Transition (n, n) and input (n,) of ``x' = A x + B u`` over a time with u held."""
    n = len(B)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A * time_s, B * time_s
    out: Float = scipy.linalg.expm(block)
    return out[:n, :n], out[:n, n]
