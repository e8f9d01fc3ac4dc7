"""The data file of a VAL3 application: variables with the place of every number."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from counterflex.core.arrays import Float
from counterflex.core.errors import ProgramError
from counterflex.programs.robot_text.process_words import NUMBER
from counterflex.programs.val3.program import LETTERS, Key, Val3Data, Val3Value, frame_of

_DATA: Final = re.compile(r"<Data\b([^<>]*?)(/?)>")
_VALUE: Final = re.compile(r"<Value\b([^<>]*?)\s*(/?)>")
_ATTRIBUTE: Final = re.compile(r"([A-Za-z:]\w*)\s*=\s*\"([^\"<>]*)\"")
_KEY: Final = re.compile(r"([A-Za-z_]\w*)\s*(?:\[\s*(\d+)\s*\])?")
_DEEPEST: Final = 20
_LARGEST: Final = 100_000.0
_NONE: Final = Val3Value(-1, -1, {}, {})


def key_of(text: str) -> Key | None:
    """Variable and element that a text names; None where it is computed."""
    match = _KEY.fullmatch(text.strip())
    return None if match is None else (match[1], int(match[2] or 0))


def data_file_of(program: Path) -> Path | None:
    """The data file beside a program: of the same name, or the only one; None where there is none."""
    files = sorted(file for file in program.parent.glob("*") if file.suffix.lower() == ".dtx" and file.is_file())
    own = [file for file in files if file.stem.lower() == program.stem.lower()]
    return own[0] if own else files[0] if len(files) == 1 else None


class DataFile:
    """Variables of a data file.

    Args:
        text: As read; empty where there is none.
        name: Of the file, for errors.

    Attributes:
        variables: By name.
        end: Index of ``</Datas>``.

    Raises:
        ProgramError: It is no data file, or a variable is there twice.
    """

    def __init__(self, text: str, name: str) -> None:
        self.text, self.name = text, name
        self.variables: dict[str, Val3Data] = {}
        self.end = text.find("</Datas>")
        if not text:
            return
        if self.end < 0 or "<!" in text.replace("<!--", ""):
            raise ProgramError(
                "this is no data file of VAL3, or it is cut off", where=f"{name}:1", limit="<Database> ... <Datas> ...",
                hint="Give the .dtx file of the application, as the post wrote it",
            )  # fmt: skip
        blank = re.sub(r"<!--.*?-->", lambda match: " " * len(match[0]), text, flags=re.DOTALL)
        for match in _DATA.finditer(blank, 0, self.end):
            about = {part[1]: part[2] for part in _ATTRIBUTE.finditer(match[1])}
            variable = about.get("name", "")
            if not variable or variable in self.variables:
                raise self._fault("a variable without a name, or there twice", match.start(), "<Data name= ... >")
            stop = match.end() if match[2] else blank.find("</Data>", match.end())
            if stop < 0:
                raise self._fault("a variable is not closed", match.start(), "</Data>")
            values = dict(self._value(match) for match in _VALUE.finditer(blank, match.end(), stop))
            self.variables[variable] = Val3Data(about.get("type", ""), match[0], values)

    def _value(self, match: re.Match[str]) -> tuple[int, Val3Value]:
        spans, attributes = {}, {}
        for part in _ATTRIBUTE.finditer(self.text, match.start(1), match.end(1)):
            attributes[part[1]], spans[part[1]] = part[2], part.span(2)
        key = attributes.get("key", "")
        if not key.isdecimal():
            raise self._fault("an element without its key", match.start(), 'key="0"')
        return int(key), Val3Value(match.start(), match.end(1), attributes, spans)

    def value(self, key: Key, kind: str) -> Val3Value | None:
        """An element of a kind; one that the file does not write is empty. None where there is no such variable."""
        data = self.variables.get(key[0])
        if data is None or data.kind != kind:
            return None
        return data.values.get(key[1], _NONE)

    def numbers(self, value: Val3Value) -> dict[str, float]:
        """X y z in mm and rx ry rz in deg of an element; what is not written is 0.

        Raises:
            ProgramError: One is no number.
        """
        out = {}
        for letter in LETTERS:
            text = value.attributes.get(letter, "0").strip()
            if not re.fullmatch(NUMBER, text) or not abs(float(text)) <= _LARGEST:
                raise self._fault(f"{letter} is no number within reach", value.data, f"at most {_LARGEST:g}")
            out[letter] = float(text)
        return out

    def frame(self, key: Key, kind: str, root: str, changed: frozenset[str] | set[str]) -> Float:
        """(4, 4) m of a frame or tool in its root, ``world`` or ``flange``, through its fathers.

        Args:
            key: The variable.
            kind: ``frame`` or ``tool``.
            root: Where the chain of fathers must end.
            changed: Variables that the program changes.

        Raises:
            ProgramError: It is not known.
        """
        T: Float | None = None
        for _ in range(_DEEPEST):
            if key == (root, 0):
                return frame_of(dict.fromkeys(LETTERS, 0.0)) if T is None else T
            value = self.value(key, kind)
            if value is None or key[0] in changed:
                break
            own = frame_of(self.numbers(value))
            T = own if T is None else own @ T
            father = key_of(value.attributes.get("fatherId", f"{root}[0]"))
            if father is None:
                break
            key = father
        raise ProgramError(
            f"where {key[0]} is, is not known", where=self.name, value=f"{key[0]}[{key[1]}]",
            limit=f"a {kind} of the data file with its numbers, fathers up to {root}, not changed by the program",
            hint="Frames of libraries and computed ones are not read: write them into the data file",
        )  # fmt: skip

    def _fault(self, what: str, at: int, limit: str) -> ProgramError:
        line = self.text.count("\n", 0, max(at, 0)) + 1
        value = " ".join(self.text[max(at, 0) : max(at, 0) + 70].split())[:60]
        return ProgramError(what, where=f"{self.name}:{line}", value=value, limit=limit,
                            hint="The file may be damaged: post it again")  # fmt: skip
