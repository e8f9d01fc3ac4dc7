"""The answer of RSI in one compiled call: correction to the wire's units, text, datagram."""

from __future__ import annotations

from typing import Final

from counterflex.core.array_table import raw_bytes, reals, whole_matrix, wholes
from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.protocols.kuka_rsi.kernel import compose
from counterflex.protocols.kuka_rsi.pose_kernel import write_axes, write_correction
from counterflex.protocols.system.system_calls import send_to

# Arrays of the table.
B_VALUES: Final = 0
B_POSE: Final = 1  # (6,) where a Cartesian correction goes; (0,): nowhere
B_AXES: Final = 2  # (6,) where an axis correction goes; (0,): nowhere
B_FREE: Final = 3  # (4,) places of Stop, FeedHold, Override and State; -1: not there
B_BUFFER: Final = 4
B_PIECES: Final = 5
B_PARTS: Final = 6
B_NAME: Final = 7  # whom to answer


@kernel("int64(int64[:, ::1], int64, int64, float64[::1], boolean, boolean, boolean, float64, int64)")
def answer(
    table: Int,
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
        table: The arrays ``B_...`` of this module; values and buffer are changed.
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
    values, free, buffer = reals(table, B_VALUES), wholes(table, B_FREE), raw_bytes(table, B_BUFFER)
    pose, axes = wholes(table, B_POSE), wholes(table, B_AXES)
    values[:] = 0.0
    if as_axes and axes.shape[0] > 0:
        write_axes(correction, values, axes)
    elif pose.shape[0] > 0:
        write_correction(correction, values, pose)
    if free[0] >= 0:
        values[free[0]] = 1.0 if stop else 0.0
    if free[1] >= 0:
        values[free[1]] = 1.0 if feed_hold else 0.0
    if free[2] >= 0:
        values[free[2]] = 100.0 * override
    if free[3] >= 0:
        values[free[3]] = float(state)
    length = compose(buffer, raw_bytes(table, B_PIECES), whole_matrix(table, B_PARTS), values, counter)
    if length > 0 and fd >= 0 and not send_to(fd, buffer, length, raw_bytes(table, B_NAME)):
        return 0
    return length
