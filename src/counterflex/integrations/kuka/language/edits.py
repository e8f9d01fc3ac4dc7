"""Edits of source lines: numbers replaced where they stand, whole lines put in, everything else as it was."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from counterflex.integrations.kuka.language import LIMITS
from counterflex.integrations.kuka.language.program import LETTERS, Target
from counterflex.programs.gcode.write.written_line import number

Values = dict[str, float]
"""X Y Z in mm, A B C in deg."""
Edit = tuple[int, int, str]
"""Start and end in a line, and what stands there instead."""


class Edits:
    """Edits of a file, applied together at the end, so that places stay those of the source."""

    def __init__(self, source: Sequence[str]) -> None:
        self._source = source
        self._changes: dict[int, list[Edit]] = {}
        self._before: dict[int, list[str]] = {}

    def change(self, line: int, edits: Sequence[Edit]) -> None:
        """Replace parts of a line (1-based)."""
        self._changes.setdefault(line, []).extend(edits)

    def insert(self, line: int, texts: Sequence[str]) -> None:
        """Put lines before a line (1-based), behind those put there already."""
        if texts:
            self._before.setdefault(line, []).extend(texts)

    def changed(self, line: int, edits: Sequence[Edit]) -> str:
        """A line with edits."""
        text, out, at = self._source[line - 1], [], 0
        for start, end, replacement in sorted(edits):
            out += [text[at:start], replacement]
            at = end
        return "".join([*out, text[at:]])

    def lines(self) -> Iterator[str]:
        """The lines with all edits."""
        for line, text in enumerate(self._source, start=1):
            yield from self._before.get(line, ())
            yield self.changed(line, self._changes[line]) if line in self._changes else text


def spelled(letter: str, value: float) -> str:
    """A component as it is written."""
    return number(value, LIMITS.position_decimals if letter in "XYZ" else LIMITS.angle_decimals)


def target_edits(target: Target, values: Values, active: Values, *, turned: bool) -> list[Edit]:
    """Edits that give a target other values; none for components that are the same within the last decimal.

    Args:
        values: To command.
        active: Where the robot is before, which components that are not written keep.
        turned: The orientation is corrected too; else A B C stay.
    """
    out: list[Edit] = []
    missing = ""
    for letter in LETTERS:
        if letter in "ABC" and not turned and letter in target.components:
            continue
        half = 0.5 * 10.0 ** -(LIMITS.position_decimals if letter in "XYZ" else LIMITS.angle_decimals)
        component = target.components.get(letter)
        if component is None:
            if abs(values[letter] - active[letter]) > half:
                missing += f",{letter} {spelled(letter, values[letter])}"
        elif abs(values[letter] - component.value) > half:
            out.append((component.start, component.end, spelled(letter, values[letter])))
    if missing:
        out.append((target.close, target.close, missing))
    return out


def target_text(target: Target, edits: Sequence[Edit]) -> str:
    """The literal of a target with edits, which count in its own line."""
    offset = target.close + 1 - len(target.source)
    moved = [(start - offset, end - offset, text) for start, end, text in edits]
    return Edits((target.source,)).changed(1, moved)
