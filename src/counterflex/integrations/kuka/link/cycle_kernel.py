"""RSI in the one call of a cycle (:mod:`counterflex.protocols.robot.compiled_link`): telegram in, answer out."""

from __future__ import annotations

from typing import Final

from numba import carray

from counterflex.core.array_table import addresses, raw_bytes, reals, to_pointer, truths, whole_matrix, wholes
from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records
from counterflex.integrations.kuka.link.answer_kernel import ARRAYS as ANSWERED, answer
from counterflex.integrations.kuka.link.kernel import OK, scan
from counterflex.integrations.kuka.link.pose_kernel import read_pose, read_stand
from counterflex.protocols.decimal_kernel import ByteRows
from counterflex.protocols.robot.compiled_link import ANSWER, READ, TELEGRAM
from counterflex.protocols.robot.session_counter import SESSION_MS

ARRAYS: Final = addresses("root", "names", "entries", "values", "seen", "numbers", "words", "pose", "axes", "actual")
"""``numbers``: those of the newest telegram; ``words``: (3,) places of Delay, Enable and Stat, -1: not there;
``pose``, ``axes``, ``actual``: (6,) places of commanded pose, angles and measured pose, (0,): nowhere."""


@kernel("void(float64[::1], int64[::1], Telegram)", Telegram=TELEGRAM)
def _read_words(numbers: Float, words: Int, t: Record) -> None:
    delay, enable, stat = words[0], words[1], words[2]
    if delay >= 0:
        t.late = int(numbers[delay])
    value = numbers[enable] if enable >= 0 else 1.0
    t.enable = int(value > 0.5)
    t.job = int(value + 0.5) if 1.5 < value < 2**31 else 0
    t.clamped = int(stat >= 0 and numbers[stat] > 1.5)


@kernel("void(Arrays[::1], Telegram[::1])", Arrays=ARRAYS, Telegram=TELEGRAM, entry=True)
def read_words(tables: Records, telegrams: Records) -> None:
    """Read what the newest telegram says beside poses and angles."""
    _read_words(reals(tables[0].numbers), wholes(tables[0].words), telegrams[0])


@kernel(READ, Telegram=TELEGRAM, entry=True)
def read_at(
    place: int,
    data: ByteRows,
    length: int,
    telegrams: Records,
    nominal: Float,
    q: Float,
    reported: Float,
    measured: Float,
) -> bool:
    """Read a telegram that is the next one of its session, see :data:`READ`.

    All others are judged by :class:`counterflex.integrations.kuka.link.link.RsiLink`, which reads them once more.
    """
    table, t = carray(to_pointer(place), (1,), ARRAYS)[0], telegrams[0]
    values, numbers, actual = reals(table.values), reals(table.numbers), wholes(table.actual)
    status, counter, _ = scan(
        data[0], length, raw_bytes(table.root), raw_bytes(table.names), whole_matrix(table.entries), values,
        truths(table.seen),
    )  # fmt: skip
    step = counter - t.newest
    if status != OK or t.newest < 0 or not 0 < step <= SESSION_MS or step % t.cycle_ms != 0:
        return False
    for k in range(numbers.shape[0]):
        numbers[k] = values[k]
    t.counter, t.elapsed = counter, step // t.cycle_ms
    _read_words(numbers, wholes(table.words), t)
    read_stand(numbers, wholes(table.pose), wholes(table.axes), nominal, q)
    if actual.shape[0] > 0:
        read_pose(numbers, actual, reported, 0)
        read_pose(numbers, actual, measured, 0)
    return True


@kernel(ANSWER, entry=True)
def answer_at(
    place: int,
    fd: int,
    counter: int,
    correction: Float,
    as_axes: bool,
    stop: bool,
    feed_hold: bool,
    override: float,
    state: int,
) -> int:
    """As :func:`.answer_kernel.answer`, by the place of its table."""
    tables = carray(to_pointer(place), (1,), ANSWERED)
    return answer(tables, fd, counter, correction, as_axes, stop, feed_hold, override, state)
