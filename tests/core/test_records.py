"""Records: one memory under names for kernels and Python, bits and all."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.jit import kernel
from counterflex.core.records import Record, Records, as_reals, as_words, record, records

SPREAD = record(total=float, squares=float)
MEMORY = record(speed=float, idle=SPREAD, cycles=int, filtered=(float, (3, 2)), classes=(SPREAD, 4))


@kernel("void(float64[::1], float64)")
def _raise(row: Float, by: float) -> None:
    for k in range(row.shape[0]):
        row[k] += by


@kernel("void(Spread, float64)", Spread=SPREAD)
def _take(spread: Record, value: float) -> None:
    spread.total += value
    spread.squares += value * value


@kernel("void(Memory[::1], float64)", Memory=MEMORY)
def follow(memories: Records, speed: float) -> None:
    m = memories[0]
    m.speed = speed
    m.cycles += 1
    _take(m.idle, speed)
    _take(m.classes[2], speed)
    _raise(m.filtered[1], speed)


def test_a_kernel_and_python_share_the_memory_of_a_record() -> None:
    memories = records(MEMORY)
    m = memories[0]
    follow(memories, 2.0)
    follow(memories, 3.0)
    assert (m.speed, m.cycles) == (3.0, 2)
    assert (m.idle.total, m.idle.squares) == (m.classes[2].total, m.classes[2].squares) == (5.0, 13.0)
    np.testing.assert_array_equal(m.filtered, [[0.0, 0.0], [5.0, 5.0], [0.0, 0.0]])
    m.speed = 7.0
    assert memories["speed"][0] == 7.0


def test_words_are_every_bit_of_it_in_the_order_of_the_fields() -> None:
    memories = records(MEMORY)
    words = as_words(memories)
    assert words.size == 1 + 2 + 1 + 6 + 8
    words[:] = np.arange(len(words))
    assert memories[0].cycles == 3
    np.testing.assert_array_equal(as_words(memories["classes"]), np.arange(10, 18))
    np.testing.assert_array_equal(as_words(memories["idle"]), [1, 2])
    as_reals(memories["idle"])[:] = 0.5, 0.25
    assert (memories[0].idle.total, memories[0].idle.squares) == (0.5, 0.25)


def test_a_field_has_no_name_that_every_record_has() -> None:
    with pytest.raises(ValueError, match="already: size"):
        record(speed=float, size=float)
