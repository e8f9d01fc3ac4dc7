"""How long jobs report progress without knowing who listens."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Told the fraction done, now and then; may raise :class:`~counterflex.core.errors.Interrupted`."""

    def __call__(self, fraction: float, what: str = "") -> None:
        """Report ``fraction`` in 0..1 of the job done and what is being worked on."""


def silent(fraction: float, what: str = "") -> None:
    """Ignore progress."""
