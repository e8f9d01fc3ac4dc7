"""Layout of a loop's memory: names, kinds and counts in order, as the run log keeps them beside the words.

A log says the layout of its own states (:data:`counterflex.files.logs.run_log.LAYOUT`), so a state is placed by name
whatever the order was. Logs of before say none: their words stand in the order of :meth:`Loop.memory` of then.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import prod
from typing import Any, Final, TypeAlias

import numpy as np

from counterflex.core.arrays import Int
from counterflex.core.errors import InputError
from counterflex.core.records import as_words

Layout: TypeAlias = tuple[tuple[str, str, int], ...]
"""Name, kind (``f8`` or ``i8``) and count of each stretch of words in order; one without a name means nothing."""
_MANY: Final = 64
"""Records from which on an array of them is one stretch, named with its fields: their names would fill the log."""
_FREE: Final = {
    "monitor.reference.turn": 1,
    "state.reference": 7,
    "state.swing": 63,
    "state.known_ahead": 64,
    "scratch": 12 + 132,
}
"""Words behind a stretch that meant nothing, or nothing beyond their cycle, in logs that do not say their layout."""
_OTHER: Final = (
    *("monitor.reference.tooth", "monitor.reference.turn_variance", "monitor.reference.change"),
    *("monitor.reference.force", "monitor.fast.change", "monitor.known_cycles", "monitor.less_cycles", "monitor.calm"),
    *("monitor.risen", "monitor.onset", "monitor.samples."),
    *("tests.heading", "tests.bend", "tests.bent", "tests.missing", "tests.early_answer", "tests.short", "tests.still"),
    *(
        "tests.plan_place",
        "tests.plan_feed",
        "tests.plan_force",
        "tests.plan_soft",
        "tests.plan_cycles",
        "tests.anchor",
    ),
)
"""Beginnings of names that logs may lack or have otherwise: they begin at zero behind a state without them."""
_SAMPLES_BEFORE: Final = 89
"""Words of fast samples in logs that do not say their layout."""
Arrays: TypeAlias = Mapping[str, np.ndarray[Any, Any]]
"""Arrays and arrays of records of 64-bit numbers, C order, by name."""


def layout_of(arrays: Arrays) -> Layout:
    """Layout of arrays one behind the other: ``ring``, ``monitor.results.ratio``; many records have numbers."""
    return tuple(stretch for name, array in arrays.items() for stretch in _stretches(name, array.dtype, array.shape))


def _stretches(name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> Iterator[tuple[str, str, int]]:
    if kind.fields is None:
        yield name, kind.str[1:], prod(shape)
        return
    if prod(shape) >= _MANY:
        yield f"{name}({' '.join(kind.names or ())})", "f8", prod(shape) * kind.itemsize // 8
        return
    for k in range(prod(shape)):
        own = name if prod(shape) == 1 else f"{name}.{k}"
        for field, (inner, *_) in kind.fields.items():
            yield from _stretches(f"{own}.{field}", inner.base, inner.shape)


def layout_before(layout: Layout) -> Layout:
    """Layout of the states in logs that do not say it: today's order, with what stood between its numbers then.

    Args:
        layout: Of the loop that takes them.
    """
    out: list[tuple[str, str, int]] = []
    for entry in layout:
        name = entry[0]
        if not name.startswith(_OTHER):
            out.append(entry)
        elif name.startswith("monitor.samples.") and ("", "f8", _SAMPLES_BEFORE) not in out:
            out.append(("", "f8", _SAMPLES_BEFORE))
        if name in _FREE:
            out.append(("", "f8", _FREE[name]))
    return tuple(out)


def words_of(arrays: Arrays) -> Int:
    """(n,) copy of all numbers, bit for bit, in the order of :func:`layout_of`."""
    return np.concatenate([as_words(array) for array in arrays.values()])


def put_words(arrays: Arrays, words: Int, layout: Layout) -> None:
    """Write words into the arrays, each to its name.

    Args:
        arrays: Written.
        words: (n,) of :func:`words_of`.

    Raises:
        InputError: Not as many words as the layout says, or names, kinds or counts of other arrays. Nothing is written.
    """
    size = sum(count for _, _, count in layout)
    if words.shape != (size,):
        raise InputError("the state is another loop's", value=f"{words.size} numbers", limit=size)
    new = layout_of(arrays)
    placed = words if layout == new else _rearranged(words, layout, new)
    first = 0
    for array in arrays.values():
        own = as_words(array)
        own[:] = placed[first : first + own.size]
        first += own.size


def _rearranged(words: Int, old: Layout, new: Layout) -> Int:
    parts: dict[tuple[str, str, int], Int] = {}
    first = 0
    for stretch in old:
        if stretch[0]:
            parts[stretch] = words[first : first + stretch[2]]
        first += stretch[2]
    strange = next((s for s in sorted(set(parts) ^ set(new)) if not s[0].startswith(_OTHER)), None)
    if strange is not None:
        name, kind, count = strange
        whose = "the state" if strange in parts else "this loop"
        raise InputError("the state is another loop's", value=f"{name}: {count} x {kind} only in {whose}")
    return np.concatenate([parts.get(stretch, np.zeros(stretch[2], dtype=np.int64)) for stretch in new])
