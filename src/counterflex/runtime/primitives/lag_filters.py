"""Second-order filters of six signals whose memory lies in the state of the step."""

from __future__ import annotations

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel

MEMORY = 24
"""Numbers of memory: for each signal the last two inputs, then the last two outputs."""


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def lag(x: Float, c: Float, memory: Float, out: Float) -> None:
    """One sample: ``y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''``.

    Args:
        x: (6,) samples.
        c: (5,) ``b0 b1 b2 a1 a2``.
        memory: (24,); changed.
        out: (6,) written; may be ``x``.
    """
    for k in range(6):
        m, u = 4 * k, x[k]
        y = c[0] * u + c[1] * memory[m] + c[2] * memory[m + 1]
        y -= c[3] * memory[m + 2] + c[4] * memory[m + 3]
        memory[m + 1], memory[m] = memory[m], u
        memory[m + 3], memory[m + 2] = memory[m + 2], y
        out[k] = y
