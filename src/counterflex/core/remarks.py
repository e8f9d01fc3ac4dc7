"""Sentences about an input that a person reads whatever becomes of the result: who reads a file says them once.

A job has no console. It calls :func:`remark`; the command that runs it prints what its own tables have not shown.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar

_heard: ContextVar[dict[str, bool] | None] = ContextVar("heard", default=None)


@contextlib.contextmanager
def collected() -> Iterator[dict[str, bool]]:
    """Collect the remarks made while the block runs.

    Yields:
        Each sentence once, in order; True where it was shown.
    """
    remarks: dict[str, bool] = {}
    token = _heard.set(remarks)
    try:
        yield remarks
    finally:
        _heard.reset(token)


def remark(sentence: str) -> None:
    """Make a remark; lost where nobody collects them."""
    remarks = _heard.get()
    if remarks is not None:
        remarks.setdefault(sentence, False)


def shown(text: str) -> None:
    """Note that a text has been shown: remarks in it are not shown twice."""
    remarks = _heard.get() or {}
    for sentence in remarks:
        if sentence in text:
            remarks[sentence] = True
