"""The words of a path statement: coordinates, feed, radius compensation, M functions, each with its place."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.heidenhain.language.source import Statement
from counterflex.integrations.heidenhain.language.values import VALUE, Values, required
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
_OF_M: Final = frozenset((103, 118, 120, 128, 140))
"""M functions that take an F (or X Y Z of M118) written behind them."""


@dataclass(frozen=True, slots=True)
class Item:
    """A word: its value (1 of a word without one) and its place; ``text`` is what stands behind the name."""

    name: str
    value: Value
    start: int
    end: int
    literal: bool


def _items(part: Statement, begin: int, values: Values, name: str) -> Iterator[Item]:
    at, code, behind_m = begin, part.code, False
    while True:
        at += len(code[at:]) - len(code[at:].lstrip())
        if at >= len(code):
            return
        kind, match = next(((k, m) for k, p in _TOKENS if (m := p.match(code, at)) is not None), ("", None))
        if match is None or (match.end() < len(code) and kind == "valued" and code[match.end()].isalnum()
                             and code[match.end()].isdigit()):  # fmt: skip
            word = code[at:].split()[0]
            raise part.fault(name, "an unknown word of Klartext", at, word[:20])
        if kind == "bare":
            yield Item("".join(match[0].split()).upper(), 1.0, at, match.end(), True)
        elif kind == "sense":
            yield Item("DR", 1.0 if match[2] == "+" else -1.0, at, match.end(), True)
        elif kind == "back":
            yield Item("MB", 1.0, at, match.end(), True)
        else:
            key, text = match[1].upper(), match[2]
            yield Item(f"{key}|M" if behind_m and key in ("F", "X", "Y", "Z") else key, values.number(text), at,
                       match.end(), "Q" not in text.upper())  # fmt: skip
            behind_m = behind_m or (key == "M" and text.strip().isdecimal() and int(text) in _OF_M)
        at = match.end()


class PathWords:
    """Words of one statement.

    Args:
        part: The statement.
        begin: Index behind its path function.
        values: Parameters.
        name: Of the program, for errors.

    Raises:
        ProgramError: A word that is unknown, there twice, or has no known value where one is needed.
    """

    def __init__(self, part: Statement, begin: int, values: Values, name: str) -> None:
        self.part, self._name = part, name
        self.m: list[tuple[int, Item]] = []  # M functions, in order
        self.items: dict[str, Item] = {}  # All words by name; M functions not
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

    def fault(self, what: str, item: Item | str | None = None, hint: str = "") -> ProgramError:
        """Make an error at a word."""
        at = self.items.get(item) if isinstance(item, str) else item
        value = None if at is None else self.part.code[at.start : at.end].strip()
        return self.part.fault(self._name, what, None if at is None else at.start, value, hint)

    def number(self, item: Item) -> float:
        """Return the value of a word.

        Raises:
            ProgramError: It is not known.
        """
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

    def take_item(self, name: str) -> Item | None:
        """Use a word whose value need not be known."""
        if name not in self._unused:
            return None
        self._unused.discard(name)
        return self.items[name]

    def finish(self) -> None:
        """Refuse words that nothing used.

        Raises:
            ProgramError: There is one.
        """
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
