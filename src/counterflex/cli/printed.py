"""Standard output and standard error of a command: everything that is printed is text, whatever names hold."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from types import TracebackType
from typing import Any, TextIO

from counterflex.core.printable import printable


class Printed:
    """A stream that shows control characters instead of passing them on; all else is that of the stream below."""

    def __init__(self, below: TextIO) -> None:
        self.below = below  # The stream itself, for what draws tables and progress bars: it has escaped names before

    def write(self, text: str) -> int:
        """Write a text."""
        self.below.write(printable(text))
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write several texts."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.below, name)


@contextlib.contextmanager
def everything_is_text() -> Iterator[None]:
    """Let standard output and standard error show control characters while the block runs."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = Printed(before[0]), Printed(before[1])
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def print_fault(kind: type[BaseException], fault: BaseException, trace: TracebackType | None) -> None:
    """Print the traceback of a fault of the program as text, as the hook of the interpreter."""
    with everything_is_text():
        sys.__excepthook__(kind, fault, trace)


def below(stream: TextIO) -> TextIO:
    """Return the stream itself."""
    return stream.below if isinstance(stream, Printed) else stream
