"""Text of a job: header, positions and instructions, each with its place; the folder that it lies in."""

from __future__ import annotations

import bisect
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.file_content import content
from counterflex.integrations.yaskawa.language import program as inform
from counterflex.integrations.yaskawa.language.table import OPENS, row_of
from counterflex.programs.robot_text.process_words import NUMBER
from counterflex.programs.robot_text.program import Span
from counterflex.programs.source_text import read_text
from counterflex.programs.statement_table import Statement as Row

_HEADER: Final = re.compile(r"(/{1,4})\s*([A-Za-z][\w-]*)\s*(.*)")
_ENTRY: Final = re.compile(r"(BC|EC|BP|EX|C|P)(\d{1,6})\s*=\s*", re.IGNORECASE)
_VALUE: Final = re.compile(rf"\s*({NUMBER})\s*(,|$)")
_NPOS: Final = re.compile(r"\s*(\d+)")
_NAMED: Final = re.compile(r"(?<![\w#$])C(\d+)\b", re.IGNORECASE)
_CALLED: Final = re.compile(r"\bJOB:([^\s(]+)", re.IGNORECASE)
_TYPES: Final = (inform.PULSE, *inform.WORLD, inform.USER, "TOOL", "MTOOL", "MASTER")
_MOST_VALUES: Final = 8
_REMARKS: Final = ("'", "//")
_CLOSES: Final = {closing: opening for opening, closing in OPENS.items()}
_REMARK: Final = re.compile(r"(?<=\S)\s+//.*")
_LOCAL_NAME: Final = re.compile(r"L(?:BP|EX|[BIDRSP])\s*\d+\s+\S+", re.IGNORECASE)
_LARGEST_MM: Final = 100_000.0
_DAMAGED: Final = "The file may be damaged: post it again"
_IGNORED: Final = frozenset({"DATE", "COMM", "ATTR", "LVARS", "LVARSNAME", "ENDVARS", "VERSION", "EDITLOCK"})


@dataclass(frozen=True, slots=True)
class InformStatement:
    """An instruction."""

    head: int  # Index at which its line begins
    start: int  # Index of its first character
    end: int  # Index behind its last character
    code: str  # The text between
    line: int  # 1-based


class InformJob:
    """A job, divided.

    Attributes:
        labels: Index of the instruction by name of its label.
        partner: Index of the end by that of the beginning of a block, and the other way round.
        branches: Of a block the indices of its ELSEIFEXP, ELSE, CASE and DEFAULT.

    Raises:
        ProgramError: A part is missing or damaged.
    """

    def __init__(self, text: str, name: str, *, complete: bool = True, encoding: str = "utf-8") -> None:
        self.text, self.name, self.encoding = text, name, encoding
        self._begins = [0, *(match.end() for match in re.finditer(r"\r\n|\n|\r", text))]
        self.positions: dict[tuple[str, int], inform.Position] = {}  # Entries by kind and number
        self.statements: list[InformStatement] = []  # Instructions behind NOP, comments and empty lines included
        self.frame = ""  # Frame of a relative job (``////FRAME``): ``USER 2``, ``ROBOT``; empty of others
        self._npos: Span = (0, 0)
        self._first = 0
        self._header = inform.Header()
        self._behind: tuple[int, inform.Header] | None = None
        self._part, self._ended = "", False
        self._read(complete)
        self.codes = [one.code for one in self.statements]  # Their code
        self._match_blocks()

    # ---- places --------------------------------------------------------------------------------------------

    def place(self, at: int) -> str:
        """``name:line:column`` of an index."""
        line = bisect.bisect_right(self._begins, at)
        return f"{self.name}:{line}:{at - self._begins[line - 1] + 1}"

    def fault(self, at: int, what: str, limit: str | None = None, hint: str = _DAMAGED) -> ProgramError:
        """Return the error of an index."""
        line = bisect.bisect_right(self._begins, at)
        begin, end = self._begins[line - 1], self._begins[line] if line < len(self._begins) else len(self.text)
        shown = " ".join(self.text[begin:end].split())[:60]
        return ProgramError(what, where=self.place(at), value=shown, limit=limit, hint=hint)

    @property
    def stem(self) -> str:
        """Name without its ending, upper case."""
        return Path(self.name).stem.upper()

    def about(self) -> inform.JobText:
        """Return what a program keeps of it."""
        mentions: dict[int, int] = {}
        for code in self.codes:
            for match in _NAMED.finditer("" if code.startswith(_REMARKS) else code):
                mentions[int(match[1])] = mentions.get(int(match[1]), 0) + 1
        behind, header = self._behind or (self._after_pos, inform.Header())
        followed = any(one.start > behind for one in self.positions.values())
        return inform.JobText(self.text, self.positions, mentions, self._npos, behind, header, followed, self._first)

    # ---- parts ---------------------------------------------------------------------------------------------

    def _read(self, complete: bool) -> None:
        if not self.text.strip():
            raise ProgramError("the program is empty", where=f"{self.name}:1:1", hint="Post it again")
        bounds = [*self._begins[1:], len(self.text)]
        for line, (begin, end) in enumerate(zip(self._begins, bounds, strict=True), start=1):
            raw = self.text[begin:end]
            code = raw.strip()
            at = begin + len(raw) - len(raw.lstrip())
            if not code and (self._part != "//INST" or self._ended or at >= len(self.text)):
                continue
            if not self._part:
                self._begin(code, at)
            elif self._ended:
                raise self.fault(at, "something follows END", "one job in a file", "Give one job in a file")
            elif self._part == "//INST":
                code = _REMARK.sub("", code) if not code.startswith(_REMARKS) else code
                self._instruction(InformStatement(begin, at, at + len(code), code, line))
            else:
                self._pseudo(code, at)
        for word, stands in (("//INST", self._part == "//INST"), ("NOP", self._first > 0),
                            ("END", self._ended or not complete)):  # fmt: skip
            if not stands:
                raise ProgramError(
                    f"the job has no {word}: it may be cut off", where=f"{self.name}:{len(self._begins)}:1",
                    limit="/JOB //NAME //POS //INST NOP ... END",
                    hint="Post it again" + (", or say --without-end if it is complete" if word == "END" else ""),
                )  # fmt: skip

    def _begin(self, code: str, at: int) -> None:
        if code.startswith("'"):
            return
        if code.upper() != "/JOB":
            raise self.fault(at, "the file does not begin with /JOB", "/JOB", "Give the job itself (.JBI)")
        self._part = "/JOB"

    def _pseudo(self, code: str, at: int) -> None:
        """A line before //INST."""
        match = _HEADER.fullmatch(code)
        word = "" if match is None else match[2].upper()
        if match is not None and len(match[1]) == 2:
            if word not in ("NAME", "POS", "INST", "ARGINFO"):
                raise self.fault(at, "an unknown part of a job", "//NAME //POS //ARGINFO //INST")
            self._part = f"//{word}"
            if word == "POS":
                self._after_pos = at + len(code)
        elif self._part == "//POS":
            if match is not None:
                self._position_header(word, match[3].strip(), at, at + match.start(3))
            elif not code.startswith("'"):
                self._entry(code, at)
        elif self._part != "//ARGINFO" and not (self._part == "//NAME" and word == "FOLDERNAME"):
            raise self.fault(at, "a line of the header that is not understood", "//POS or //INST")

    _after_pos: int = 0

    def _position_header(self, word: str, text: str, at: int, at_text: int) -> None:
        if word == "NPOS":
            match = _NPOS.match(text)
            if match is None:
                raise self.fault(at, "the number of positions is missing", "///NPOS 1,0,0,0,0,0")
            self._npos = (at_text + match.start(1), at_text + match.end(1))
        elif word in ("USER", "TOOL"):
            if not text.isdecimal() or int(text) > 999:
                raise self.fault(at, f"the number of ///{word} is missing", f"///{word} 1")
            number = int(text)
            self._header = replace(self._header, user=number) if word == "USER" else replace(self._header, tool=number)
        elif word == "POSTYPE":
            if text.upper() not in _TYPES:
                raise self.fault(at, "an unknown type of positions", " ".join(_TYPES))
            self._header = replace(self._header, postype=text.upper())
        elif word == "RCONF":
            self._header = replace(self._header, rconf="".join(text.split()))
        elif word not in ("PULSE", "RECTAN"):
            raise self.fault(at, "a line of //POS that is not understood", "///TOOL ///USER ///POSTYPE ///RCONF")

    def _entry(self, code: str, at: int) -> None:
        match = _ENTRY.match(code)
        if match is None:
            raise self.fault(at, "this is no position", "C00000=10.000,0.000,0.000,0.0000,0.0000,0.0000")
        kind, number = match[1].upper(), int(match[2])
        numbers, values, here = [], [], match.end()
        while here < len(code):
            value = _VALUE.match(code, here)
            if value is None or (value[2] == "" and value.end() < len(code)):
                raise self.fault(at + here, "a value of a position is not understood", "numbers with commas between")
            numbers.append((at + value.start(1), at + value.end(1)))
            values.append(float(value[1]))
            here = value.end()
        if kind in ("C", "P"):
            self._check_values(values, at)
        if (kind, number) in self.positions:
            raise self.fault(at, f"{match[1]}{match[2]} is there twice", "once")
        end = numbers[-1][1] if numbers else at + len(code)
        self.positions[kind, number] = inform.Position(
            kind, number, at, end, tuple(numbers), tuple(values), self._header
        )
        if kind == "C":
            self._behind = (end, self._header)

    def _check_values(self, values: list[float], at: int) -> None:
        pulses = self._header.postype == inform.PULSE
        if not self._header.postype:
            raise self.fault(at, "nothing says what the numbers of a position are", "///POSTYPE before it")
        if not inform.AXES <= len(values) <= _MOST_VALUES or any(values[inform.AXES :]):
            raise self.fault(
                at, "a position has another number of values than a robot with six axes",
                "S L U R B T" if pulses else "X Y Z Rx Ry Rz", "Robots with seven axes are not read",
            )  # fmt: skip
        if not pulses and any(abs(value) > _LARGEST_MM for value in values):
            raise self.fault(at, "a position is beyond every robot", f"{_LARGEST_MM:g} mm")

    def _instruction(self, statement: InformStatement) -> None:
        code, at = statement.code, statement.start
        if self._first == 0:
            match = _HEADER.fullmatch(code)
            if match is not None and len(match[1]) >= 3:
                self._instruction_header(match[2].upper(), match[3].strip(), at)
            elif code.upper() == "NOP":
                self._first = next((b for b in self._begins if b > at), len(self.text))
            elif code and not _LOCAL_NAME.fullmatch(code):
                raise self.fault(at, "the instructions do not begin with NOP", "NOP")
        elif code.upper() == "END":
            self._ended = True
        else:
            self.statements.append(statement)

    def _instruction_header(self, word: str, text: str, at: int) -> None:
        if word == "FRAME":
            self.frame = " ".join(text.upper().split())
        elif word.startswith("GROUP"):
            groups = [group.strip() for group in text.upper().split(",")]
            if "RB1" not in groups if word == "GROUP1" else any(group.startswith("RB") for group in groups):
                raise self.fault(
                    at, "the job moves another robot than the first", "///GROUP1 RB1",
                    "Give the job of one robot: those of several robots are not read",
                )  # fmt: skip
        elif word not in _IGNORED:
            raise self.fault(at, "a line of //INST that is not understood", " ".join(sorted(_IGNORED)))

    # ---- blocks --------------------------------------------------------------------------------------------

    def _match_blocks(self) -> None:
        self.labels: dict[str, int] = {}
        self.partner: dict[int, int] = {}
        self.branches: dict[int, list[int]] = {}
        open_blocks: list[tuple[str, int]] = []
        for at, code in enumerate(self.codes):
            word = code.split()[0].upper() if code and not code.startswith(_REMARKS) else ""
            here, inside = self.statements[at].start, open_blocks[-1][0] if open_blocks else ""
            if word.startswith("*"):
                if word in self.labels:
                    raise self.fault(here, f"the label {word} is there twice", "once")
                self.labels[word] = at
            elif word in OPENS:
                open_blocks.append((word, at))
                self.branches[at] = []
            elif word in _CLOSES:
                if inside != _CLOSES[word]:
                    raise self.fault(here, f"{word} closes nothing", _CLOSES[word])
                begin = open_blocks.pop()[1]
                self.partner[begin], self.partner[at] = at, begin
            elif word in ("ELSEIFEXP", "ELSE", "CASE", "DEFAULT"):
                needed = "SWITCH" if word in ("CASE", "DEFAULT") else "IFTHENEXP"
                if inside != needed:
                    raise self.fault(here, f"{word} belongs into {needed}", needed)
                self.branches[open_blocks[-1][1]].append(at)
        if open_blocks:
            word, at = open_blocks[-1]
            raise self.fault(self.statements[at].start, f"{word} is not closed", OPENS[word])

    def row(self, at: int) -> Row | None:
        """Row of the table of an instruction; None of an unknown one, and of a comment."""
        return row_of(self.codes[at])


class InformFolder:
    """Jobs that a job can call."""

    def __init__(self, files: Iterable[Path] = (), *, complete: bool = True) -> None:
        self._files, self._complete = list(files), complete
        self.jobs: dict[str, InformJob] = {}

    def find(self, name: str, refuse: Callable[[str, str], ProgramError]) -> InformJob | None:
        """Return a job by its name; None where the folder has none.

        Raises:
            ProgramError: Several files have the name, or it cannot be read.
        """
        own = sorted((file for file in self._files if file.stem.upper() == name.upper()), key=str)
        if len(own) > 1:
            raise refuse(f"several files of the folder are called {name}", f"Keep one of {', '.join(map(str, own))}")
        if not own:
            return None
        file = own[0].name
        if file not in self.jobs:
            text, encoding = read_text(own[0])
            self.jobs[file] = InformJob(text, file, complete=self._complete, encoding=encoding)
        return self.jobs[file]


def jobs_beside(file: Path) -> list[Path]:
    """Return the other jobs of a job's folder."""
    if not file.parent.is_dir():
        return []
    return [one for one in file.parent.iterdir()
            if one.suffix.lower() == ".jbi" and one.is_file() and one.name != file.name]  # fmt: skip


def job_files(file: Path) -> tuple[Path, ...]:
    """Return the jobs of a folder that a job names in CALL or JUMP, and those that they name."""
    by_name = {one.stem.upper(): one for one in jobs_beside(file)}
    reached: dict[str, Path] = {}
    open_files = [file]
    while open_files:
        one = open_files.pop()
        text = content(one).decode("latin-1") if one.is_file() else ""
        for match in _CALLED.finditer(text):
            name = match[1].upper()
            if name in by_name and name not in reached:
                reached[name] = by_name[name]
                open_files.append(by_name[name])
    return tuple(reached[name] for name in sorted(reached))
