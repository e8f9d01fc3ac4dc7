"""The data file of a VAL3 application: variables with the place of every number, in the forms of s6 and s7."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.integrations.staubli.language.program import Val3Data, Val3Value
from counterflex.programs.robot_text.process_words import NUMBER

_DATA: Final = re.compile(r"<Data\b([^<>]*?)(/?)>")
_VALUE: Final = re.compile(r"<Value\b([^<>]*?)\s*(/?)>")
_ATTRIBUTE: Final = re.compile(r"([A-Za-z:]\w*)\s*=\s*\"([^\"<>]*)\"")
_OLD: Final = re.compile(
    r"<(frame|tool|point|pointRs|pointVrb|joint|jointRs|jointVrb|mdesc|num|bool|string|trsf|config|configRs|dio|aio|sio)"
    r"\s([^<>]*?)(/?)>"
)
"""A variable of the form of s6."""
_OLD_FATHER: Final = re.compile(r"<[fpt]Father\b([^<>]*?)/?>")
_OLD_VALUE: Final = re.compile(r"<value(\w+)([^<>]*?)(/?)>")
_TAG: Final = re.compile(r"<(?!/|!|io\b)\w+([^<>]*?)\s*/?>")
_KINDS: Final = {"point": "pointRx", "joint": "jointRx", "config": "configRx"}
LARGEST: Final = 100_000.0


def data_file_of(program: Path) -> Path | None:
    """The data file of a program: of the same name, that of its project, or the only one; None where there is none."""
    files = sorted(file for file in program.parent.glob("*") if file.suffix.lower() == ".dtx" and file.is_file())
    own = [file for file in files if file.stem.lower() == program.stem.lower()]
    if own:
        return own[0]
    projects = [file for file in program.parent.glob("*") if file.suffix.lower() == ".pjx" and file.is_file()]
    if len(projects) == 1:
        own = [file for file in files if file.stem.lower() == projects[0].stem.lower()]
    return own[0] if own else files[0] if len(files) == 1 else None


class DataFile:
    """Variables of a data file.

    Args:
        text: As read; empty where there is none.
        name: Of the file, for errors.

    Raises:
        ProgramError: It is no data file, or a variable is there twice.
    """

    def __init__(self, text: str, name: str) -> None:
        self.text, self.name = text, name
        self.variables: dict[str, Val3Data] = {}  # By name
        self.old = "<dataList" in text  # It is in the form of s6
        # Index of ``</Datas>``, in the form of s6 of ``</dataList>``
        self.end = text.find("</dataList>" if self.old else "</Datas>")
        if not text:
            return
        if self.end < 0 or "<!" in text.replace("<!--", ""):
            raise ProgramError(
                "this is no data file of VAL3, or it is cut off", where=f"{name}:1", limit="<Database> ... <Datas> ...",
                hint="Give the .dtx file of the application, as the post wrote it",
            )  # fmt: skip
        blank = re.sub(r"<!--.*?-->", lambda match: " " * len(match[0]), text, flags=re.DOTALL)
        if self.old:
            self._read_old(blank)
        else:
            self._read(blank)

    def _read(self, blank: str) -> None:
        for match in _DATA.finditer(blank, 0, self.end):
            about = {part[1]: part[2] for part in _ATTRIBUTE.finditer(match[1])}
            variable = self._new(about.get("name", ""), match.start())
            stop = match.end() if match[2] else blank.find("</Data>", match.end())
            if stop < 0:
                raise self._fault("a variable is not closed", match.start(), "</Data>")
            values = {}
            for one in _VALUE.finditer(blank, match.end(), stop):
                attributes, spans = self._attributes(one.start(1), one.end(1))
                key = attributes.get("key", "")
                if not key.isdecimal():
                    if "," in key:
                        continue  # an element of a table: its value is not known
                    raise self._fault("an element without its key", one.start(), 'key="0"')
                values[int(key)] = Val3Value(one.start(), one.end(1), attributes, spans)
            self.variables[variable] = Val3Data(about.get("type", ""), match[0], values, self._size(about, values))

    def _read_old(self, blank: str) -> None:
        at = 0
        while (match := _OLD.search(blank, at, self.end)) is not None:
            kind, about = match[1], {part[1]: part[2] for part in _ATTRIBUTE.finditer(match[2])}
            variable = self._new(about.get("name", ""), match.start())
            at = stop = match.end() if match[3] else blank.find(f"</{kind}>", match.end())
            if stop < 0:
                raise self._fault("a variable is not closed", match.start(), f"</{kind}>")
            father = _OLD_FATHER.search(blank, match.end(), stop)
            values: dict[int, Val3Value] = {}
            for one in _OLD_VALUE.finditer(blank, match.end(), stop):
                behind = one.end() if one[3] else blank.find(f"</value{one[1]}>", one.end(), stop)
                value = self._old_value(one, behind, father)
                values[int(value.attributes.get("index", "0"))] = value
            self.variables[variable] = Val3Data(_KINDS.get(kind, kind), match[0], values, self._size(about, values))

    def _old_value(self, match: re.Match[str], behind: int, father: re.Match[str] | None) -> Val3Value:
        """An element with the attributes of all tags within it."""
        attributes, spans = self._attributes(match.start(2), match.end(2))
        end = -1
        for tag in _TAG.finditer(self.text, match.end(), behind):
            own, places = self._attributes(tag.start(1), tag.end(1))
            end = tag.end(1) if "x" in own or end < 0 else end
            attributes, spans = {**own, **attributes}, {**places, **spans}
        if father is not None:
            about = {part[1]: part[2] for part in _ATTRIBUTE.finditer(father[1])}
            if about.get("name"):
                alias = f"{about['alias']}:" if about.get("alias") else ""
                attributes["fatherId"] = f"{alias}{about['name']}[{about.get('fatherIndex', '0')}]"
        return Val3Value(match.start(), end if end >= 0 else match.end(2), attributes, spans)

    def _new(self, variable: str, at: int) -> str:
        if not variable or variable in self.variables:
            raise self._fault("a variable without a name, or there twice", at, "<Data name= ... >")
        return variable

    def _attributes(self, start: int, end: int) -> tuple[dict[str, str], dict[str, tuple[int, int]]]:
        spans, attributes = {}, {}
        for part in _ATTRIBUTE.finditer(self.text, start, end):
            attributes[part[1]], spans[part[1]] = part[2], part.span(2)
        return attributes, spans

    @staticmethod
    def _size(about: dict[str, str], values: dict[int, Val3Value]) -> int:
        size = about.get("size", "")
        return int(size) if size.isdecimal() else max(values, default=0) + 1

    def number(self, value: Val3Value, letter: str) -> float:
        """A number of an element; 0 where it is not written. Raises ProgramError: it is none."""
        text = value.attributes.get(letter, "0").strip()
        if not re.fullmatch(NUMBER, text) or not abs(float(text)) <= LARGEST:
            raise self._fault(f"{letter} is no number within reach", value.data, f"at most {LARGEST:g}")
        return float(text)

    def _fault(self, what: str, at: int, limit: str) -> ProgramError:
        line = self.text.count("\n", 0, max(at, 0)) + 1
        value = " ".join(self.text[max(at, 0) : max(at, 0) + 70].split())[:60]
        return ProgramError(what, where=f"{self.name}:{line}", value=value, limit=limit,
                            hint="The file may be damaged: post it again")  # fmt: skip
