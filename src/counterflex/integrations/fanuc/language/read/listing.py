"""Text of a listing: its parts, the statements of ``/MN`` and the positions of ``/POS``, each with its place."""

from __future__ import annotations

import bisect
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeVar

from counterflex.core.errors import ProgramError
from counterflex.integrations.fanuc.language.program import LETTERS, FanucPosition
from counterflex.programs.robot_text.process_words import NUMBER

T = TypeVar("T")
_PART: Final = re.compile(r"^[^\S\r\n]*/(PROG|ATTR|APPL|MN|POS|END)\b[^\r\n]*", re.MULTILINE | re.IGNORECASE)
_NUMBERED: Final = re.compile(r"[^\S\r\n]*\d*[^\S\r\n]*:[^\S\r\n]*")
_CONTINUED: Final = re.compile(r"(?<=\n)([^\S\r\n]*):")
_ENTRY: Final = re.compile(r"\s*P\s*\[\s*((\d+)(?:\s*:\s*(?:\"[^\"\r\n]*\"|[^\]\r\n]*))?)\s*\]\s*\{", re.IGNORECASE)
_GROUP: Final = re.compile(r"\bGP\s*(\d)\s*:", re.IGNORECASE)
_FRAMES: Final = re.compile(
    r"\s*UF\s*:\s*(\d+|F)\s*,\s*UT\s*:\s*(\d+|F)\s*,\s*(?:CONFIG\s*:\s*'([^'\r\n]*)'\s*,?)?", re.IGNORECASE
)
_VALUE: Final = re.compile(rf"\s*([XYZWPR]|J\d|E[1-3])\s*=\s*({NUMBER}|\*+)\s*(mm|deg)?\s*(,|(?=\Z))", re.IGNORECASE)
_DEFAULT_GROUP: Final = re.compile(r"DEFAULT_GROUP\s*=\s*([\d*])", re.IGNORECASE)
_LARGEST: Final = 100_000.0


@dataclass(frozen=True, slots=True)
class TpStatement:
    """A statement of ``/MN``."""

    head: int  # Index at which its line begins, or behind the statement before it on that line
    start: int  # Index of its first character behind the line number
    end: int  # Index of its semicolon
    code: str  # The text between, colons of continued lines as blanks, without blanks around it
    line: int  # 1-based line of ``start``


class Listing:
    """A listing divided into parts.

    Raises:
        ProgramError: A part is missing, or twice there.
    """

    def __init__(self, text: str, name: str, *, complete: bool) -> None:
        self.text, self.name = text, name
        self._ends = [match.start() for match in re.finditer(r"\r\n|\n|\r", text)]
        if not text.strip():
            raise ProgramError("the program is empty", where=f"{name}:1:1", hint="Post it again")
        parts = self._parts(complete=complete)
        order = sorted(parts.values(), key=lambda match: match.start())
        stop = {match[1].upper(): n.start() for match, n in itertools.pairwise(order)}
        self.main = parts["MN"].end()  # Index behind the line ``/MN``
        self._main_end = stop.get("MN", len(text))
        self._positions = (parts["POS"].end(), stop.get("POS", len(text))) if "POS" in parts else (len(text),) * 2
        # Index behind the last position
        self.behind = self._positions[0] if "POS" in parts or "END" not in parts else parts["END"].start()
        self.has_positions = "POS" in parts  # There is a part /POS
        self.ended = "END" in parts
        about = text[parts["PROG"].end() : parts["MN"].start()]
        group = _DEFAULT_GROUP.search(about)
        self.moves_arm = group is None or group[1] != "*"  # It may move group 1 (DEFAULT_GROUP)

    def _parts(self, *, complete: bool) -> dict[str, re.Match[str]]:
        """Head lines of the parts, by name."""
        text, name = self.text, self.name
        parts: dict[str, re.Match[str]] = {}
        for match in _PART.finditer(text):
            key = match[1].upper()
            if key in parts:
                raise ProgramError(
                    f"/{key} is there twice", where=self.place(match.start()),
                    limit=f"once; first in line {self.line(parts[key].start())}", hint="Give one program in a file",
                )  # fmt: skip
            parts[key] = match
        if "PROG" not in parts or text[: parts["PROG"].start()].strip():
            raise ProgramError(
                "the file does not begin with /PROG", where=f"{name}:1:1", value=text.strip().splitlines()[0][:60],
                limit="/PROG NAME", hint="Give the listing (.ls); compiled programs (.tp) are not read",
            )  # fmt: skip
        for key in ("MN", *(("END",) if complete else ())):
            if key not in parts:
                raise ProgramError(
                    f"the listing has no /{key}: it may be cut off", where=f"{name}:{len(self._ends) or 1}",
                    limit="/PROG /ATTR /MN /POS /END",
                    hint="Post it again" + ("" if key == "MN" else ", or say --without-end if it is complete"),
                )  # fmt: skip
        return parts

    def line(self, at: int) -> int:
        """1-based line of an index."""
        return bisect.bisect_left(self._ends, at) + 1

    def place(self, at: int) -> str:
        """``name:line:column`` of an index."""
        line = self.line(at)
        before = self.text.rfind("\n", 0, at) + 1
        return f"{self.name}:{line}:{at - before + 1}"

    def statements(self) -> Iterator[TpStatement]:
        """Statements in order. Raises ProgramError: one is not closed."""
        at, stop = self.main, self._main_end
        while True:
            while at < stop and self.text[at].isspace():
                at += 1
            if at >= stop:
                return
            line_begin = self.text.rfind("\n", 0, at) + 1
            head = max(line_begin, self.main) if not self.text[line_begin:at].strip() else at
            match = _NUMBERED.match(self.text, at, stop)
            start = at if match is None else match.end()
            end = self.text.find(";", start, stop)
            if end < 0:
                raise ProgramError(
                    "a statement without its semicolon: the file may be cut off", where=self.place(at),
                    value=self.text[at:stop].strip().splitlines()[0][:60], hint="Post the program again",
                )  # fmt: skip
            code = _CONTINUED.sub(r"\1 ", self.text[start:end])
            yield TpStatement(head, start, end, code, self.line(start))
            at = end + 1

    def positions(self) -> dict[int, FanucPosition]:
        """Entries of ``/POS`` by number. Raises ProgramError: an entry is damaged, or there twice."""
        out: dict[int, FanucPosition] = {}
        at, stop = self._positions
        while (match := _ENTRY.match(self.text, at, stop)) is not None:
            close = self.text.find("}", match.end(), stop)
            end = self.text.find(";", close, stop) if close >= 0 else -1
            if end < 0 or self.text[close + 1 : end].strip():
                raise self._fault("a position is not closed", match.start(), "P[1]{ ... };")
            entry = self._entry(match, close, end + 1)
            if entry.number in out:
                raise self._fault(f"P[{entry.number}] is there twice", match.start(), "once")
            out[entry.number] = entry
            at = self.behind = end + 1
        if self.text[at:stop].strip():
            raise self._fault("this is no position", at + len(self.text[at:stop]) - len(self.text[at:stop].lstrip()),
                              "P[1]{ GP1: UF : 1, UT : 1, CONFIG : 'N U T, 0, 0, 0', X = ... };")  # fmt: skip
        return out

    def _entry(self, match: re.Match[str], close: int, end: int) -> FanucPosition:
        text, begin = self.text, match.end()
        start = match.start() + len(match[0]) - len(match[0].lstrip())
        groups = list(_GROUP.finditer(text, begin, close))
        if not groups or groups[0][1] != "1" or text[begin : groups[0].start()].strip():
            raise self._fault("a position without values of group 1", start, "P[1]{ GP1: ... };")
        stop = groups[1].start() if len(groups) > 1 else close
        frames = _FRAMES.match(text, groups[0].end(), stop)
        if frames is None:
            raise self._fault("a position does not say its frames", start, "GP1: UF : 1, UT : 1, CONFIG : '...'")
        values, numbers = self._values(frames.end(), stop, start)
        named = LETTERS if set(LETTERS) <= values.keys() else ""
        if not named and "J1" not in values:
            raise self._fault("a position without all of X Y Z W P R", start, "X Y Z W P R, or J1 to J6")
        return FanucPosition(
            int(match[2]), start, end, match.span(1),
            _chosen(numbers, named),
            _chosen(values, named),
            _number(frames[1]), _number(frames[2]),
            {int(key[1]): value for key, value in values.items() if key[0] == "E"},
            "" if stop == close else "".join(text[stop:close].split()),
            {key: value for key, value in values.items() if key[0] == "J"},
            (frames[3] or "").strip(),
        )  # fmt: skip

    def _values(self, at: int, stop: int, start: int) -> tuple[dict[str, float], dict[str, tuple[int, int]]]:
        """Values of a position by name, mm and deg, and the places of their numbers."""
        text, numbers, values = self.text, {}, {}
        while text[at:stop].strip():
            value = _VALUE.match(text, at, stop)
            if value is None or value[1].upper() in values or (value[3] or "").lower() not in _units(value[1]):
                raise self._fault("a value of a position is not understood", at, "X = 12.5 mm, W = 180.0 deg")
            if value[2].startswith("*"):
                raise self._fault("a position was never taught", start, "numbers", hint="Teach it, or post it again")
            key = value[1].upper()
            values[key] = float(value[2])
            if not abs(values[key]) <= _LARGEST:
                raise self._fault(f"{key} is beyond every robot", value.start(2), f"{_LARGEST:g}")
            numbers[key] = value.span(2)
            at = value.end()
        return values, numbers

    def _fault(
        self, what: str, at: int, limit: str, hint: str = "The file may be damaged: post it again"
    ) -> ProgramError:
        value = " ".join(self.text[at : at + 80].split())[:60]
        return ProgramError(what, where=self.place(at), value=value, limit=limit, hint=hint)


def _units(key: str) -> tuple[str, ...]:
    return (
        ("mm", "deg")
        if key.upper() in ("E1", "E2", "E3", "J7", "J8", "J9")
        else ("mm",)
        if key.upper() in "XYZ"
        else ("deg",)
    )


def _number(text: str) -> int | None:
    return None if text.upper() == "F" else int(text)


def _chosen(values: dict[str, T], names: str) -> dict[str, T]:
    return {name: values[name] for name in names}
