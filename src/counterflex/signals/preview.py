"""Commands that a lightly damped structure turns into a wanted motion, when the future is known.

A command reaches the tool through the drives and the structure: it comes late, overshoots and rings. Planning knows
what is wanted ahead of time, so the command can begin early and be shaped such that the structure makes of it what is
wanted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Float, Int, as_float, as_positive
from counterflex.core.errors import InputError
from counterflex.core.jit import kernel
from counterflex.core.units import MS

_PER_PERIOD: Final = 20
_COARSEST_S: Final = 4.0 * MS
_MARGIN: Final = 12  # Time constants by which a stretch of path is extended, both ways, at rest
_MOST_SAMPLES: Final = 4_000_000


@dataclass(frozen=True)
class Mode:
    """A structural mode, as a tap test at the tool shows it with the drives on."""

    omega_rad_s: float  # undamped angular frequency, > 0
    damping_ratio: float  # > 0

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("mode frequency", self.omega_rad_s)
        as_positive("mode damping ratio", self.damping_ratio)

    @property
    def hz(self) -> float:
        """Frequency, Hz."""
        return self.omega_rad_s / (2.0 * math.pi)

    @property
    def ring_s(self) -> float:
        """Time constant with which it dies out, ``1 / (omega D)``."""
        return 1.0 / (self.omega_rad_s * self.damping_ratio)


@dataclass(frozen=True)
class Shaping:
    """Shaping of a command in time."""

    # tau of command_for: motion faster than this is given up for a gentle command; 0 leaves modes out and asks for the
    # wanted motion as it is
    smoothing_s: float
    lead_s: float  # dead time of a command, by which it is sent earlier, >= 0

    def __post_init__(self) -> None:
        """Check ranges."""
        as_positive("smoothing of the correction", self.smoothing_s, zero=True)
        as_positive("lead of the correction", self.lead_s, zero=True)


def command_for(
    requested: Float, time_s: Float, modes: tuple[Mode, ...], shaping: Shaping, swung: Float | None = None
) -> Float:
    """The command whose passage through modes comes nearest to a wanted motion.

    With ``P = prod_i (1 + 2 zeta_i/w_i d/dt + 1/w_i^2 d2/dt2)``, the inverse of the modes, the motion x solves
    ``min integral (x - y)^2 + tau^4 (d2u/dt2)^2 dt`` with ``u = P x``; the command is ``u(t + lead)``. Outside the
    stretch the wanted motion goes on as at its ends.

    Args:
        requested: (n, k) motion y at the tool.
        time_s: (n,) s, non-decreasing.
        modes: What the command passes; none gives a mere smoothing.
        shaping: tau and lead.
        swung: (n, k) a further wanted motion that is to be passed through the first mode before it is added, as a
            force makes the arm swing; or None.

    Returns:
        (n, k) the command at the times given.

    Raises:
        InputError: Wrong shapes, times that go back, a stretch of more than 4 million samples, a mode to pass through
            is missing.
    """
    y = as_float("wanted", requested, (None, None))
    time = as_float("time_s", time_s, (len(y),))
    if len(y) == 0:
        return y.copy()
    if np.any(np.diff(time) < 0.0):
        raise InputError("times go back", value=float(np.min(np.diff(time))), limit=">= 0 s")
    tau = shaping.smoothing_s
    if swung is not None and not modes:
        raise InputError("there is no mode to pass through")
    if tau == 0.0:
        ahead = time + shaping.lead_s
        return _resampled(y if swung is None else y + as_float("swung", swung, y.shape), time, ahead)
    h = min([_COARSEST_S] + [2.0 * np.pi / mode.omega_rad_s / _PER_PERIOD for mode in modes])
    margin = shaping.lead_s + _MARGIN * max([tau, h] + [1.0 / mode.omega_rad_s for mode in modes])
    count = int(np.ceil((time[-1] - time[0] + 2.0 * margin) / h)) + 1
    if count > _MOST_SAMPLES:
        raise InputError(
            "the stretch of path is too long", value=f"{time[-1] - time[0]:.0f} s", limit=_MOST_SAMPLES * h
        )
    grid = time[0] - margin + h * np.arange(count)
    target = _resampled(y, time, grid)
    if swung is not None:
        target += _passed(_resampled(as_float("swung", swung, y.shape), time, grid), h, modes[0])
    inverse = np.array([1.0])
    for mode in modes:
        square = (mode.omega_rad_s * h) ** 2
        half = mode.damping_ratio / (mode.omega_rad_s * h)
        inverse = np.convolve(inverse, [1.0 / square + half, 1.0 - 2.0 / square, 1.0 / square - half])
    bend = np.convolve(inverse, np.array([1.0, -2.0, 1.0])) * (tau / h) ** 2
    reach = len(bend) // 2
    padded = np.pad(target, ((reach, reach), (0, 0)), mode="edge")
    motion = _smoothed(padded, bend)
    width = len(inverse) // 2
    ends = np.pad(motion, ((width, width), (0, 0)), mode="edge")
    command = np.stack([np.convolve(column, inverse, mode="valid") for column in ends.T], axis=1)
    command = command[reach : len(command) - reach]
    out = np.empty_like(y)
    for k in range(y.shape[1]):
        out[:, k] = np.interp(time + shaping.lead_s, grid, command[:, k])
    return out


def _resampled(values: Float, time: Float, grid: Float) -> Float:
    out: Float = np.stack([np.interp(grid, time, column) for column in values.T], axis=1)
    return out


def _passed(values: Float, h: float, mode: Mode) -> Float:
    """Output of a mode, at rest before; exact for an input that is held."""
    w = mode.omega_rad_s
    swings = np.array([[0.0, 1.0], [-w * w, -2.0 * mode.damping_ratio * w]])
    out: Float = np.empty_like(values, order="C")
    _swing(np.ascontiguousarray(values), np.ascontiguousarray(scipy.linalg.expm(h * swings)), out)
    return out


@kernel("void(float64[:, ::1], float64[:, ::1], float64[:, ::1])", entry=True)
def _swing(values: Float, after: Float, out: Float) -> None:
    """Swing of a mode about an input that is held over each step; ``after``: its free swing after one step."""
    for k in range(values.shape[1]):
        place, speed = values[0, k], 0.0
        out[0, k] = place
        for i in range(1, values.shape[0]):
            about = values[i - 1, k]
            off = place - about
            place = about + after[0, 0] * off + after[0, 1] * speed
            speed = after[1, 0] * off + after[1, 1] * speed
            out[i, k] = place


def _smoothed(target: Float, bend: Float) -> Float:
    """``min |x - y|^2 + |bend * x|^2``, banded normal equations; rows of ``bend`` at the ends are left out."""
    n, size = len(target), len(bend)
    bands = np.zeros((size, n))
    bands[-1] = 1.0
    for i in range(size):
        for j in range(i, size):
            # Rows r = 0 .. n - size: element r + i times element r + j.
            bands[size - 1 - (j - i), j : n - size + 1 + j] += bend[i] * bend[j]
    out: Float = scipy.linalg.solveh_banded(bands, target, check_finite=False)
    return out


def by_group(
    requested: Float, swung: Float, time_s: Float, group: Int, modes: tuple[Mode, ...], shaping: Shaping
) -> Float:
    """:func:`command_for` for each stretch of a path by itself.

    Args:
        requested: (n, k).
        swung: (n, k).
        time_s: (n,).
        group: (n,) rows that follow each other without interruption have one number; non-decreasing.

    Returns:
        (n, k).
    """
    out = np.zeros_like(requested)
    starts = np.flatnonzero(np.diff(group, prepend=group[:1] - 1))
    for begin, end in zip(starts, [*starts[1:], len(group)][: len(starts)], strict=True):
        rows = slice(int(begin), int(end))
        if np.any(requested[rows]) or np.any(swung[rows]):
            out[rows] = command_for(requested[rows], time_s[rows], modes, shaping, swung[rows])
    return out


@dataclass(frozen=True)
class Ahead:
    """Path of a force and of a correction against it to the tool.

    Raises:
        InputError: No mode, or a share out of range.
    """

    # of the deflection that the arm makes, 0 .. 1: it swings through the first mode, the rest follows at once
    arm_share: float
    modes: tuple[Mode, ...]  # what a correction passes, the arm's first
    shaping: Shaping  # smoothing and dead time

    def __post_init__(self) -> None:
        """Check ranges."""
        if not self.modes:
            raise InputError("a correction passes the arm's mode at least")
        if not 0.0 <= self.arm_share <= 1.0:
            raise InputError("share of the arm in the deflection", value=self.arm_share, limit="0 .. 1")

    def command(self, requested: Float, time_s: Float, moved: Float | float = 0.0) -> Float:
        """Command of the next cycle, see :func:`counterflex.signals.preview.command_for`.

        Args:
            requested: (n, k) deflection, or force, that would be there if nothing swung.
            time_s: (n,) s, not decreasing.
            moved: (n, k) likewise, but as it is there in time: nothing of it swings any further.

        Returns:
            (n, k) likewise.
        """
        at_once = (1.0 - self.arm_share) * requested + moved
        return command_for(at_once, time_s, self.modes, self.shaping, self.arm_share * requested)
