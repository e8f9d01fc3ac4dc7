"""The answer of RSI in one compiled call: correction to the wire's units, text, datagram."""

from __future__ import annotations

from typing import Final

from counterflex.core.array_table import addresses, raw_bytes, reals, whole_matrix, wholes
from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Records
from counterflex.integrations.kuka.link.kernel import compose
from counterflex.integrations.kuka.link.pose_kernel import write_axes, write_correction
from counterflex.protocols.system.system_calls import send_to

ARRAYS: Final = addresses("values", "pose", "axes", "free", "buffer", "pieces", "parts", "name")
"""``pose``, ``axes``: (6,) places where a Cartesian or axis correction goes; (0,): nowhere. ``free``: (4,) places of
Stop, FeedHold, Override and State; -1: not there. ``name``: whom to answer."""


@kernel(
    "int64(Arrays[::1], int64, int64, float64[::1], boolean, boolean, boolean, float64, int64)",
    Arrays=ARRAYS,
    entry=True,
)
def answer(
    tables: Records,
    fd: int,
    counter: int,
    correction: Float,
    as_axes: bool,
    stop: bool,
    feed_hold: bool,
    override: float,
    state: int,
) -> int:
    """Write an answer, and send it.

    Args:
        tables: (1,) ARRAYS; values and buffer are changed.
        fd: Socket to send with; below zero: the answer is only written.
        counter: IPOC that is answered.
        correction: (6,) m and rotation vector, or with ``as_axes`` rad.
        as_axes: Axis corrections.
        stop: Tell the controller to stop.
        feed_hold: Ask for the feed to be held.
        override: Speed of the program, 0..1.
        state: Number of the loop's state.

    Returns:
        Bytes of the answer; 0: a number cannot be written, or the system did not take it, and nothing was sent.
    """
    table = tables[0]
    values, free, buffer = reals(table.values), wholes(table.free), raw_bytes(table.buffer)
    pose, axes = wholes(table.pose), wholes(table.axes)
    at_stop, at_hold, at_override, at_state = free[0], free[1], free[2], free[3]
    values[:] = 0.0
    if as_axes and axes.shape[0] > 0:
        write_axes(correction, values, axes)
    elif pose.shape[0] > 0:
        write_correction(correction, values, pose)
    if at_stop >= 0:
        values[at_stop] = 1.0 if stop else 0.0
    if at_hold >= 0:
        values[at_hold] = 1.0 if feed_hold else 0.0
    if at_override >= 0:
        values[at_override] = 100.0 * override
    if at_state >= 0:
        values[at_state] = float(state)
    length = compose(buffer, raw_bytes(table.pieces), whole_matrix(table.parts), values, counter)
    if length > 0 and fd >= 0 and not send_to(fd, buffer, length, raw_bytes(table.name)):
        return 0
    return length
