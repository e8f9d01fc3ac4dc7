"""Edits of a text by index: parts replaced where they stand, others put in, everything else as it was."""

from __future__ import annotations

Edit = tuple[int, int, str]
"""Start, end, and what stands there instead; the same start and end put something in."""


class Spans:
    """Edits of a text, applied together at the end, so that indices stay those of the source."""

    def __init__(self) -> None:
        self._edits: list[Edit] = []

    def replace(self, start: int, end: int, text: str) -> None:
        """Replace what stands between two indices."""
        self._edits.append((start, end, text))

    def insert(self, at: int, text: str) -> None:
        """Put something in, behind what was put in there already."""
        self._edits.append((at, at, text))

    def sorted(self) -> list[Edit]:
        """The edits in order of their places; those of one place as they were made."""
        return sorted(self._edits, key=lambda edit: (edit[0], edit[1]))

    def __eq__(self, other: object) -> bool:
        """Return whether two lists of edits make the same text."""
        return isinstance(other, Spans) and self.sorted() == other.sorted()

    def __hash__(self) -> int:
        """Not hashed by contents."""
        return id(self)

    def __iadd__(self, other: Spans) -> Spans:
        """Take the edits of another list too."""
        self._edits += other._edits
        return self

    def within(self, start: int, end: int) -> Spans:
        """The edits between two indices."""
        out = Spans()
        out._edits = [edit for edit in self._edits if start <= edit[0] and edit[1] <= end]
        return out

    def applied(self, text: str, start: int = 0, end: int | None = None) -> str:
        """The text between two indices with the edits."""
        end, out, at = len(text) if end is None else end, [], start
        for first, last, replacement in self.sorted():
            out += [text[at:first], replacement]
            at = last
        return "".join([*out, text[at:end]])
