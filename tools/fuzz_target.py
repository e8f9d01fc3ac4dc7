"""One reader that is fuzzed: its good inputs, and how an independent reader judges it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from fuzz_coverage import Instrumented


class Finding(Exception):
    """The reader and its judge do not agree."""


@dataclass(eq=False)
class Target:
    """One reader."""

    seeds: Sequence[bytes]  # good telegrams
    text: bool  # they are text
    # reads one with the reader and the judge; raises where they differ; returns whether it was accepted
    check: Callable[[bytes], bool]
    read: Callable[[bytes], object]  # reads one with the reader alone, for timing
    # runs one through the reader with counters, or None: not a kernel of ours
    instrumented: Callable[[bytes], object] | None = None
    coverage: Instrumented | None = field(default=None, repr=False)  # the counters of that
