"""The words of a loop's memory are placed by their names, whatever the order in which a log has them."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.records import record, records
from counterflex.runtime.state.memory_layout import Layout, layout_of, put_words, words_of

SPREAD = record(total=float, number=int)
SEEN = record(force=(float, (3, 2)), spread=SPREAD, classes=(SPREAD, 2))


def arrays() -> dict[str, np.ndarray]:
    ring: Float = np.arange(6, dtype=np.float64).reshape(2, 3)
    seen = records(SEEN)
    seen[0].classes[1].number = 7
    seen[0].force[2, 1] = -0.5
    return {"ring": ring, "seen": seen, "counts": np.array([3, 4])}


def test_the_layout_names_every_number_in_order() -> None:
    assert layout_of(arrays()) == (
        ("ring", "f8", 6),
        ("seen.force", "f8", 6),
        *(("seen.spread.total", "f8", 1), ("seen.spread.number", "i8", 1)),
        *(("seen.classes.0.total", "f8", 1), ("seen.classes.0.number", "i8", 1)),
        *(("seen.classes.1.total", "f8", 1), ("seen.classes.1.number", "i8", 1)),
        ("counts", "i8", 2),
    )
    assert words_of(arrays()).size == sum(count for _, _, count in layout_of(arrays()))


@pytest.mark.parametrize("gap", [0, 3])
def test_words_of_another_order_go_to_their_names(gap: int) -> None:
    """A stretch without a name means nothing: what older code left free between its numbers."""
    told, empty = arrays(), {name: np.zeros_like(array) for name, array in arrays().items()}
    words, layout = words_of(told), layout_of(told)
    put_words(empty, words, layout)
    np.testing.assert_array_equal(words_of(empty), words)
    order = np.random.default_rng(1).permutation(len(layout))
    begins = np.cumsum([0] + [count for _, _, count in layout])
    parts = [words[begins[k] : begins[k] + layout[k][2]] for k in order]
    mixed = np.concatenate([np.full(gap, 99), *parts])
    empty = {name: np.zeros_like(array) for name, array in told.items()}
    put_words(empty, mixed, (("", "f8", gap), *(layout[k] for k in order)))
    np.testing.assert_array_equal(words_of(empty), words)


@pytest.mark.parametrize(
    ("layout", "fault"),
    [
        ((("ring", "f8", 6), ("counts", "i8", 2)), "got 20 numbers; expected 8"),
        ((("ring", "f8", 6), ("seen", "f8", 12), ("counts", "i8", 2)), "seen: 12 x f8 only in the state"),
        ((("ring", "f8", 20),), "counts: 2 x i8 only in this loop"),
    ],
)
def test_words_of_other_arrays_are_refused_and_nothing_is_written(layout: Layout, fault: str) -> None:
    mine = arrays()
    before = words_of(mine)
    with pytest.raises(InputError, match=f"another loop's.*{fault}"):
        put_words(mine, np.zeros(20, dtype=np.int64), layout)
    np.testing.assert_array_equal(words_of(mine), before)
