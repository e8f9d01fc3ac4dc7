"""How long jobs report progress without knowing who listens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol


class Progress(Protocol):
    """Progress callback, fraction 0 to 1, now and then; may raise :class:`~counterflex.core.errors.Interrupted`."""

    def __call__(self, fraction: float, what: str = "") -> None:
        """Report ``fraction`` in 0..1 of the job done and what is being worked on."""


def silent(fraction: float, what: str = "") -> None:
    """Ignore progress."""


def in_parts(progress: Progress, parts: Mapping[str, float]) -> dict[str, Progress]:
    """Share a job's progress among its parts, one behind the other.

    Who listens is told where the parts end, if it wants to know (``planned``, as
    :class:`~counterflex.core.meter.Meter` has it).

    Args:
        parts: Work of each part in the order in which they are done, in any common unit; the name says what is done.

    Returns:
        By name, the progress of each part: its fraction done 0..1 becomes a fraction of the whole, and where nothing
        is said about what is done, its name is.
    """
    total = sum(parts.values())
    out: dict[str, Progress] = {}
    before = 0.0
    for name, work in parts.items():
        out[name] = _Part(progress, before / total, (before + work) / total, name)
        before += work
    _plan(progress, [part.end for part in out.values() if isinstance(part, _Part)])
    return out


def share_of(progress: Progress, fraction_before: float, fraction_after: float, what: str = "") -> Progress:
    """Progress of a stretch of a job, for loops.

    Args:
        fraction_before: Fraction of the job done before, 0..1.
        fraction_after: Fraction of the job done after.
        what: What is said whatever the stretch says; empty leaves it to the stretch.
    """
    return _Part(progress, fraction_before, fraction_after, what, always=bool(what))


def saying(progress: Progress, what: str) -> Progress:
    """The same progress, saying this whatever is said of its parts."""
    return _Part(progress, 0.0, 1.0, what, always=True)


class _Part:
    """Progress of a part of a job."""

    def __init__(self, progress: Progress, begin: float, end: float, name: str, *, always: bool = False) -> None:
        self.progress, self.begin, self.end, self.name, self.always = progress, begin, end, name, always

    def __call__(self, fraction: float, what: str = "") -> None:
        """Report the fraction of the part as one of the whole."""
        place = (1.0 - fraction) * self.begin + fraction * self.end
        self.progress(place, self.name if self.always else what or self.name)

    def planned(self, fractions: Sequence[float]) -> None:
        """Tell where parts of this part end."""
        _plan(self.progress, [(1.0 - end) * self.begin + end * self.end for end in fractions])


def _plan(progress: Progress, ends: Sequence[float]) -> None:
    tell = getattr(progress, "planned", None)
    if tell is not None:
        tell(ends)
