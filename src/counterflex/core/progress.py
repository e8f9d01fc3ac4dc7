"""How long jobs report progress without knowing who listens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Progress(Protocol):
    """Told the fraction done, now and then; may raise :class:`~counterflex.core.errors.Interrupted`."""

    def __call__(self, fraction: float, what: str = "") -> None:
        """Report ``fraction`` in 0..1 of the job done and what is being worked on."""


def silent(fraction: float, what: str = "") -> None:
    """Ignore progress."""


def in_parts(progress: Progress, parts: Mapping[str, float]) -> dict[str, Progress]:
    """Share a job's progress among its parts, one behind the other.

    Args:
        progress: Of the whole job.
        parts: Work of each part in the order in which they are done, in any common unit; the name says what is done.

    Returns:
        By name, the progress of each part: its fraction done 0..1 becomes a fraction of the whole, and where nothing
        is said about what is done, its name is.
    """
    total = sum(parts.values())
    out: dict[str, Progress] = {}
    before = 0.0
    for name, work in parts.items():
        out[name] = _part(progress, before / total, (before + work) / total, name)
        before += work
    return out


def _part(progress: Progress, begin: float, end: float, name: str) -> Progress:
    return lambda fraction, what="": progress((1.0 - fraction) * begin + fraction * end, what or name)
