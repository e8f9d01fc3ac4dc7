"""Second-order filters of six signals whose memory lies in the state of the step."""

from __future__ import annotations

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel

MEMORY = 24
"""Numbers of memory: for each signal the last two inputs, then the last two outputs."""


@kernel("void(float64[::1], int64, float64[::1], int64, float64[::1], int64, float64[::1], int64)")
def lag(x: Float, at_x: int, c: Float, at_c: int, memory: Float, at_m: int, out: Float, at_out: int) -> None:
    """One sample: ``y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''``.

    Args:
        x: Array that holds the six samples from ``at_x`` on.
        at_x: See above.
        c: Array that holds ``b0 b1 b2 a1 a2`` from ``at_c`` on.
        at_c: See above.
        memory: Array that holds the memory (24) from ``at_m`` on; changed.
        at_m: See above.
        out: Array that takes the six results from ``at_out`` on.
        at_out: See above.
    """
    for k in range(6):
        m = at_m + 4 * k
        u = x[at_x + k]
        y = c[at_c] * u + c[at_c + 1] * memory[m] + c[at_c + 2] * memory[m + 1]
        y -= c[at_c + 3] * memory[m + 2] + c[at_c + 4] * memory[m + 3]
        memory[m + 1], memory[m] = memory[m], u
        memory[m + 3], memory[m + 2] = memory[m + 2], y
        out[at_out + k] = y
