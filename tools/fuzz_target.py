"""One reader that is fuzzed: its good inputs, and how an independent reader judges it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from fuzz_coverage import Instrumented


class Finding(Exception):
    """The reader and its judge do not agree."""


@dataclass(eq=False)
class Target:
    """One reader.

    Attributes:
        seeds: Good telegrams.
        text: They are text.
        check: Reads one with the reader and the judge; raises where they differ; returns whether it was accepted.
        read: Reads one with the reader alone, for timing.
        instrumented: Runs one through the reader with counters, or None: not a kernel of ours.
        coverage: The counters of that.
    """

    seeds: Sequence[bytes]
    text: bool
    check: Callable[[bytes], bool]
    read: Callable[[bytes], object]
    instrumented: Callable[[bytes], object] | None = None
    coverage: Instrumented | None = field(default=None, repr=False)
