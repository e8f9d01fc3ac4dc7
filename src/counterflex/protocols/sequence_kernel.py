"""Order of numbered samples: new ones, late and repeated ones, and a source that counts anew. Compiled.

No number is believed alone that lies behind the newest, or far ahead: one damaged datagram may say so, and the right
ones behind it would be passed over as old until the count has gone half round.
"""

from __future__ import annotations

from typing import Final

from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, record

ORDER: Final = record(
    newest=int,  # number of the newest sample taken; -1 before the first
    astray=int,  # number of the last one that was passed over
    run=int,  # such numbers in a row that go on from each other
    restarts=int,  # how often the source began to count again
)
"""State of the sequence numbers of one source."""
RESTART: Final = 16
"""Samples in a row whose numbers go on from each other, behind the newest or far ahead, until they are believed."""
FAR: Final = 4096
"""Steps ahead that a sample may claim alone: 4 s at 1 kHz."""
_FOLLOWS: Final = 10
"""Steps from one of them to the next at most: some are lost."""


@kernel("int64(Order, int64, int64)", Order=ORDER)
def steps_on(order: Record, number: int, mask: int) -> int:
    """Steps from the newest sample to this one, which becomes the newest; 0: it is passed over.

    Args:
        order: See :data:`ORDER`; changed.
        mask: Largest number, after which they begin again at 0: ``2^bits - 1``.

    Returns:
        At least 1 for a new sample; 1 too for the first that is believed of a source that counts again.
    """
    half = (mask + 1) // 2
    step = (number - order.newest) & mask if order.newest >= 0 else 1
    if step == 0:
        return 0
    if step > FAR or step >= half:
        follows = order.run > 0 and 0 < (number - order.astray) & mask <= _FOLLOWS
        order.run = order.run + 1 if follows else 1
        order.astray = number
        if order.run < RESTART:
            return 0
        if step >= half:
            order.restarts += 1
            step = 1
    order.run, order.newest = 0, number
    return int(step)


@kernel("int64(Order[::1], int64, int64)", Order=ORDER, entry=True)
def next_step(orders: Records, number: int, mask: int) -> int:
    """:func:`steps_on` for a caller that is no kernel; ``orders``: (1,) ORDER."""
    return int(steps_on(orders[0], number, mask))
