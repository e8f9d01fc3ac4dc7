"""Faults of the computer (disk full, no permission, file too large) in whatever form a library raises them.

Python raises ``OSError`` with a number. Libraries in Rust and C++ (polars, mcap, small-gicp) raise their own exceptions
with the number or the text of the system in the message. The edges of the program, :mod:`counterflex.core.atomic` for
what is written and ``counterflex.cli.start`` for all else, ask here.
"""

from __future__ import annotations

import errno
import os
import re
from typing import Final

FULL: Final = frozenset(
    getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO", "EPIPE", "EROFS") if hasattr(errno, name)
)
"""Numbers of a disk or a pipe that takes no more."""
_RUST: Final = re.compile(r"\(os error (\d+)\)")
_MOST_LINKS: Final = 20  # Exceptions of one chain that are looked at; a chain may be a circle


def system_fault(fault: BaseException) -> OSError | None:
    """Return the fault of the operating system behind an exception, or None where there is none.

    Args:
        fault: Any exception, of Python or of a library.

    Returns:
        An ``OSError`` with ``errno`` and ``strerror``. Exceptions that were only being handled when ``fault``
        was raised count where their number is in :data:`FULL`: such a fault does not pass by itself.
    """
    link: BaseException | None = fault
    handled = False
    for _ in range(_MOST_LINKS):
        if link is None:
            return None
        match = _of_one(link)
        if match is not None and (not handled or match.errno in FULL):
            return match
        if link.__cause__ is None and not link.__suppress_context__:
            link, handled = link.__context__, True
        else:
            link = link.__cause__
    return None


def _of_one(fault: BaseException) -> OSError | None:
    """Read one exception alone: its number, the number in its message, or the text of a full disk."""
    if isinstance(fault, OSError) and fault.errno and fault.strerror:
        return fault
    text = str(fault)
    known = _RUST.search(text)
    if known is not None:
        number = int(known[1])
        return OSError(number, os.strerror(number))
    return next((OSError(number, os.strerror(number)) for number in FULL if os.strerror(number) in text), None)
