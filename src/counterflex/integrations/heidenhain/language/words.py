"""The words of a path statement: coordinates, feed, radius compensation, M functions, each with its place."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.heidenhain.language.source import KlartextStatement
from counterflex.integrations.heidenhain.language.values import VALUE, KlartextValues, required
from counterflex.programs.expression import Value
from counterflex.programs.program import Word

AXES: Final = "XYZ"
ROTARY: Final = "ABC"
_TOKENS: Final = tuple(
    (kind, re.compile(pattern, re.IGNORECASE))
    for kind, pattern in (
        ("bare", r"F\s*MAX(?![A-Z0-9])|F\s*AUTO(?![A-Z0-9])|R0(?![\d.,])|RL(?![A-Z])|RR(?![A-Z])|R[+-](?!\s*[\d.,Q])"),
        ("sense", r"(DR)\s*([+-])(?!\s*[\d.,Q])"),
        ("back", rf"(MB)\s*(MAX|{VALUE})"),
        ("valued", rf"(I?P[RA]|I?[XYZABC]|[TN][XYZ]|FU|FZ|LA|F|R|S|M)\s*({VALUE})"),
    )
)
_OF_M: Final = frozenset((103, 118, 120, 128, 140))  # M functions that take an F (or X Y Z of M118) written behind them


@dataclass(frozen=True, slots=True)
class WordItem:
    """A word: its value (1 of a word without one) and its place; ``text`` is what stands behind the name."""

    name: str
    value: Value
    start: int
    end: int
    literal: bool


def _items(part: KlartextStatement, begin: int, values: KlartextValues, name: str) -> Iterator[WordItem]:
    at, code, behind_m = begin, part.code, False
    while (at := at + len(code[at:]) - len(code[at:].lstrip())) < len(code):
        kind, match = _token(part, at, name)
        key, text = "".join(match[0].split()).upper(), ""
        if kind == "valued":
            key, text = match[1].upper(), match[2]
            value, literal = values.number(text), "Q" not in text.upper()
        else:
            key = {"sense": "DR", "back": "MB"}.get(kind, key)
            value, literal = -1.0 if kind == "sense" and match[2] == "-" else 1.0, True
        of_m = behind_m and text and key in ("F", "X", "Y", "Z")
        yield WordItem(f"{key}|M" if of_m else key, value, at, match.end(), literal)
        behind_m = behind_m or (key == "M" and text.strip().isdecimal() and int(text) in _OF_M)
        at = match.end()


def _token(part: KlartextStatement, at: int, name: str) -> tuple[str, re.Match[str]]:
    """Kind and match of the word that begins at an index."""
    code = part.code
    kind, match = next(((k, m) for k, p in _TOKENS if (m := p.match(code, at)) is not None), ("", None))
    if match is None or (kind == "valued" and code[match.end() : match.end() + 1].isdigit()):
        raise part.fault(name, "an unknown word of Klartext", at, code[at:].split()[0][:20])
    return kind, match


class PathWords:
    """Words of one statement.

    Args:
        begin: Index behind its path function.
        values: Parameters.
        name: Of the program, for errors.

    Raises:
        ProgramError: A word that is unknown, there twice, or has no known value where one is needed.
    """

    def __init__(self, part: KlartextStatement, begin: int, values: KlartextValues, name: str) -> None:
        self.part, self._name = part, name
        self.m: list[tuple[int, WordItem]] = []  # M functions, in order
        self.items: dict[str, WordItem] = {}  # All words by name; M functions not
        for item in _items(part, begin, values, name):
            if item.name == "M":
                number = self.number(item)
                if number != int(number):
                    raise self.fault("M needs a whole number", item)
                self.m.append((int(number), item))
            elif item.name in self.items:
                raise self.fault("the word appears twice in one block", item)
            else:
                self.items[item.name] = item
        self._unused = set(self.items)

    def fault(self, what: str, item: WordItem | str | None = None, hint: str = "") -> ProgramError:
        """Make an error at a word."""
        at = self.items.get(item) if isinstance(item, str) else item
        value = None if at is None else self.part.code[at.start : at.end].strip()
        return self.part.fault(self._name, what, None if at is None else at.start, value, hint)

    def number(self, item: WordItem) -> float:
        """Return the value of a word. Raises ProgramError: it is not known."""
        return required(item.value, f"the value of {item.name}", self.part.place(self._name, item.start),
                        self.part.code)  # fmt: skip

    def has(self, *names: str) -> bool:
        """Return whether one of the words is there and nothing has used it yet."""
        return any(name in self._unused for name in names)

    def take(self, name: str) -> float | None:
        """Use a word; None where there is none."""
        if name not in self._unused:
            return None
        self._unused.discard(name)
        return self.number(self.items[name])

    def coordinate(self, name: str) -> tuple[float, bool] | None:
        """Use a coordinate: its value, and whether it counts from where the tool stands (I); None where none is named.

        Raises:
            ProgramError: It is given absolutely and incrementally.
        """
        absolute, step = self.take(name), self.take(f"I{name}")
        if absolute is not None and step is not None:
            raise self.fault(f"{name} is given absolutely and incrementally", f"I{name}")
        return (absolute, False) if absolute is not None else None if step is None else (step, True)

    def take_item(self, name: str) -> WordItem | None:
        """Use a word whose value need not be known."""
        if name not in self._unused:
            return None
        self._unused.discard(name)
        return self.items[name]

    def finish(self) -> None:
        """Refuse words that nothing used. Raises ProgramError: there is one."""
        if self._unused:
            first = min((self.items[name] for name in self._unused), key=lambda item: item.start)
            raise self.fault("nothing in this block uses the word", first)

    def written(self, kept: Callable[[int], tuple[int, ...]]) -> tuple[Word, ...]:
        """Return the words in the roles that writers know.

        Args:
            kept: M codes that an M function stands for.
        """
        words = [Word("M", float(code), item.start, item.end, item.literal)
                 for number, item in self.m for code in kept(number)]  # fmt: skip
        roles = {"TX": "I", "TY": "J", "TZ": "K", "F": "F", "R": "R", "S": "S"}
        for item in self.items.values():
            letter = item.name.removeprefix("I")
            role = letter if letter in (*AXES, *ROTARY) else roles.get(item.name)
            if role is not None and isinstance(item.value, float):
                words.append(Word(role, item.value, item.start, item.end, item.literal,
                                  not item.name.startswith("I") if letter in (*AXES, *ROTARY) else None))  # fmt: skip
        return tuple(sorted(words, key=lambda word: word.start))
