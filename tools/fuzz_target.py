"""One reader that is fuzzed: its good inputs, and how an independent reader judges it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from fuzz_coverage import Instrumented

FAR, RESTART, FOLLOWS = 4096, 16, 10
"""Steps ahead that one sample may claim alone; samples that must go on from each other; steps between them at most."""


class Count:
    """Judge of a source's numbers: one of them alone is not believed where it lies behind or far ahead."""

    def __init__(self, bits: int) -> None:
        self.wrap, self.last = 2**bits, -1
        self.apart: list[int] = []  # numbers that go on from each other, but not from the last one

    def steps(self, number: int) -> int:
        """Steps to a sample that is taken, 0 where it is not."""
        ahead = 1 if self.last < 0 else (number - self.last) % self.wrap
        if 1 <= ahead <= FAR:
            self.last, self.apart = number, []
            return ahead
        if ahead == 0:
            return 0
        goes_on = bool(self.apart) and 1 <= (number - self.apart[-1]) % self.wrap <= FOLLOWS
        self.apart = [*self.apart, number] if goes_on else [number]
        if len(self.apart) < RESTART:
            return 0
        self.last, self.apart = number, []
        return ahead if ahead < self.wrap // 2 else 1


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
