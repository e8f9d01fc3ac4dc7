"""Faults of what a cell file describes, with the file and the key that they lie under."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from counterflex.core.errors import CounterflexError, FileFormatError


@contextlib.contextmanager
def located(where: str) -> Iterator[None]:
    """Put the file and the key in front of the place of a fault that was found deeper down."""
    try:
        yield
    except CounterflexError as fault:
        if fault.where is not None and fault.where.startswith(where):
            raise
        place = where if fault.where is None else f"{where}: {fault.where}"
        raise FileFormatError(
            fault.what, where=place, value=fault.value, limit=fault.limit, hint=fault.hint, **fault.data
        ) from fault
