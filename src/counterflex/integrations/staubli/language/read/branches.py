"""Statements of a VAL3 program whose execution depends on what is not known: passed where nothing in them matters."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.file_content import content
from counterflex.integrations.staubli.language.read.data_file import DataFile, data_file_of
from counterflex.integrations.staubli.language.read.motions import Val3MotionExecution
from counterflex.integrations.staubli.language.read.program_file import Val3Routine, arguments
from counterflex.integrations.staubli.language.read.store import Store
from counterflex.integrations.staubli.language.read.table import EFFECTS, TABLE
from counterflex.programs.expression import ExpressionError, Value
from counterflex.programs.program import Block
from counterflex.programs.robot_text.process_words import ProcessWords
from counterflex.programs.source_text import read_text
from counterflex.programs.statement_table import Statement, Treatment
from counterflex.programs.unknown import Unknown, known

_ALIAS: Final = re.compile(r"<(?:Library|alias)\b([^<>]*?)/?>")
_ATTRIBUTE: Final = re.compile(r"([A-Za-z]\w*)\s*=\s*\"([^\"<>]*)\"")
_CALLED: Final = re.compile(r"\b(?:call|taskCreate(?:Sync)?\s+[^,\n]*(?:,[^,\n]*?)?,)\s*([A-Za-z_]\w*)\s*\(")
Refuse = Callable[[str, str], ProgramError]
"""Makes the error of a message and a hint."""


class Val3Folder:
    """Programs that can be called.

    Args:
        path: Folder of the application; None where there is none.
        complete: Refuse a text without its end.
    """

    def __init__(self, path: Path | None = None, *, complete: bool = True) -> None:
        self._path, self._complete = path, complete
        self.routines: dict[tuple[str, str], Val3Routine] = {}  # Programs that were called, by alias and name
        self._libraries: dict[str, Path] = {}
        if path is not None and path.is_dir():
            for project in sorted(path.glob("*.pjx")):
                self._take_aliases(project)

    def find(self, prefix: str, name: str, store: Store, refuse: Refuse) -> Val3Routine | None:
        """Return a program; None where no file has it.

        Args:
            prefix: Alias of its library with a colon; empty of the application's own.
            store: Takes the variables of a library.
            refuse: Makes the error.

        Raises:
            ProgramError: Several files have the name, or it cannot be read.
        """
        if (prefix, name) in self.routines:
            return self.routines[prefix, name]
        folder = self._path if not prefix else self._libraries.get(prefix[:-1])
        if folder is None or not folder.is_dir():
            return None
        own = sorted(file for file in folder.iterdir() if file.suffix.lower() == ".pgx" and file.stem == name)
        if len(own) > 1:
            raise refuse(f"several files of the folder are called {name}", "Keep one of them")
        if not own:
            return None
        text, encoding = read_text(own[0])
        file = own[0].name if not prefix else f"{folder.name}/{own[0].name}"
        self.routines[prefix, name] = Val3Routine(text, file, self._complete, encoding)
        if prefix:
            self._load_data(prefix, folder, store)
        return self.routines[prefix, name]

    def load(self, alias: str, path: str, store: Store) -> bool:
        """Let an alias stand for a library; whether its folder is there."""
        if self._path is None:
            return False
        folder = self._path / path.removesuffix(".pjx").replace("\\", "/")
        folder = folder if folder.is_dir() else folder.parent if folder.with_suffix(".pjx").is_file() else folder
        self._libraries[alias] = folder
        self.routines = {key: one for key, one in self.routines.items() if key[0] != f"{alias}:"}
        if folder.is_dir():
            self._load_data(f"{alias}:", folder, store)
        return folder.is_dir()

    def _load_data(self, prefix: str, folder: Path, store: Store) -> None:
        data = data_file_of(folder / f"{folder.name}.pgx")
        if data is not None and not any(name.startswith(prefix) for name in store.globals):
            store.load(DataFile(read_text(data)[0], data.name), prefix)

    def _take_aliases(self, project: Path) -> None:
        if self._path is None:
            return
        for match in _ALIAS.finditer(read_text(project)[0]):
            about = {part[1]: part[2] for part in _ATTRIBUTE.finditer(match[1])}
            alias, path = about.get("alias") or about.get("name", ""), about.get("path", "")
            folder = self._path / path.removesuffix(".pjx").replace("\\", "/")
            if alias and path and folder.is_dir():
                self._libraries[alias] = folder


def job_files(program: Path) -> tuple[Path, ...]:
    """Return the data file of a program, and the programs of its folder that it calls, and those that they call."""
    data = data_file_of(program)
    reached: dict[str, Path] = {}
    open_files = [program]
    while open_files:
        file = open_files.pop()
        text = content(file).decode("latin-1") if file.is_file() else ""
        for match in _CALLED.finditer(text):
            called = program.with_name(f"{match[1]}{program.suffix}")
            if called != program and match[1] not in reached and called.is_file():
                reached[match[1]] = called
                open_files.append(called)
    return (*(() if data is None else (data,)), *(reached[name] for name in sorted(reached)))


OUTPUT: Final = re.compile(r"(dio|aio|sio|d[A-Z]|do|ao|out)\w*(?:\s*\[[^\]]*\])?\s*=(?!=)", re.IGNORECASE)
"""An output by its name, where the data file does not declare it."""
_KEYWORD: Final = re.compile(
    r"(call|return|if|elseIf|else|endIf|while|endWhile|for|endFor|do|until|switch|case|default|break|endSwitch"
    r"|taskCreateSync|taskCreate)\b"
)
_INSTRUCTION: Final = re.compile(r"((?:[A-Za-z_]\w*:)?[A-Za-z_]\w*)\s*\(")
_EFFECT: Final = re.compile(rf"\b({'|'.join(sorted(EFFECTS))})\s*\(")
CALL: Final = re.compile(r"(?:call|taskCreate(?:Sync)?\s+[^,]*(?:,[^,]*?)?,)\s*((?:[A-Za-z_]\w*:)?[A-Za-z_]\w*)\s*\(")
FOR: Final = re.compile(r"for\s+(.*?[^=!<>])=(?!=)(.*?)\s+to\s+(.*?)(?:\s+step\s+(.*))?")
_HINT: Final = "Post the path without loops, conditions and subprograms, or set what they depend on in the program"
_DEEPEST: Final = 20
_BRACKETS: Final = ("if", "else", "elseIf", "endIf", "while", "endWhile", "do", "until", "endFor", "switch", "case",
                    "default", "break", "endSwitch")  # fmt: skip


def assignment(code: str) -> tuple[str, str] | None:
    """Return target and value of an assignment; None of another statement."""
    depth, quoted = 0, False
    for at, character in enumerate(code):
        quoted ^= character == '"'
        depth += 0 if quoted else (character in "([{") - (character in ")]}")
        if character == "=" and depth == 0 and not quoted:
            if code[at + 1 : at + 2] == "=" or code[at - 1 : at] in ("<", ">", "!", "="):
                return None
            return code[:at].strip(), code[at + 1 :].strip()
    return None


def instruction(code: str) -> tuple[str, int] | None:
    """Return the name of an instruction and the index behind its opening bracket; None of another statement."""
    match = _INSTRUCTION.match(code)
    return None if match is None or not code.endswith(")") else (match[1], match.end())


def word_of(code: str) -> str:
    """Return the key word of a statement in the table."""
    match = _KEYWORD.match(code)
    if match is not None:
        return match[1]
    parts = assignment(code)
    if parts is not None:
        right = instruction(parts[1])
        name = "" if right is None else right[0].rpartition(":")[2]
        return name if name in EFFECTS else "="
    left = instruction(code)
    return "" if left is None else left[0].rpartition(":")[2]


def row_of(code: str) -> Statement | None:
    """Return the row of a statement; None where no row names it. Words tell capitals apart."""
    word = word_of(code)
    row = TABLE.find(word) if word else None
    return row if row is not None and row.word == word else None


def hidden_effect(code: str) -> str:
    """Return an instruction within an expression that does something beside giving a value; empty without one."""
    parts = assignment(code)
    start = len(code) - len(parts[1]) if parts is not None else 0
    inner = [match[1] for match in _EFFECT.finditer(code) if code[start : match.start()].rpartition(":")[2].strip()]
    return inner[0] if inner else ""


class Val3Branches(Val3MotionExecution):
    """Passes statements that may run or not."""

    folder: Val3Folder  # Programs that can be called
    process: ProcessWords | None
    depth: int  # Number of programs that run, one calling the other
    main: str  # Name of the main program's file
    call_line: int = 1  # Line of the main program that runs

    def pass_over(
        self, routine: Val3Routine, begin: int, end: int, condition: Unknown, opening: tuple[str, int], level: int = 0
    ) -> None:
        """Pass lines that run where an unknown condition holds.

        Args:
            begin: Index of the first line.
            condition: Why it is not known.
            opening: Word and line of the statement that the condition stands in.
            level: Calls on the way there.

        Raises:
            ProgramError: One of them moves the robot, or sets what motions depend on.
        """
        for at in range(begin, end):
            if level == 0:
                self.block(routine, at)
            if routine.codes[at]:
                self._pass(routine, at, condition, opening, level)

    def _pass(self, routine: Val3Routine, at: int, condition: Unknown, opening: tuple[str, int], level: int) -> None:
        code = routine.codes[at]
        self.act(routine, at)
        row = row_of(code)
        parts = assignment(code)
        if self._is_process(routine, at) or row is None or hidden_effect(code):
            raise self.refusal(routine, at, condition, opening)
        if row.word == "for":
            if (match := FOR.fullmatch(code)) is not None:
                self._forget(routine, at, match[1].strip(), condition)
        elif row.word in ("call", "taskCreate", "taskCreateSync"):
            self._pass_call(routine, at, condition, opening, level)
        elif row.word == "=" and parts is not None:
            if not self.is_output(code, parts[0]):
                self._forget(routine, at, parts[0], condition)
        elif row.word == "return":
            if level == 0 and (self.depth > 1 or not self._says_why(routine, at)):
                raise self.refusal(routine, at, condition, opening)
        elif not _harmless(row):
            raise self.refusal(routine, at, condition, opening)

    def _is_process(self, routine: Val3Routine, at: int) -> bool:
        """Return whether a line is of the cell's table of machine functions."""
        return self.process is not None and self.process.find([routine.codes[at]], 0, routine.place(at)) is not None

    def _pass_call(
        self, routine: Val3Routine, at: int, condition: Unknown, opening: tuple[str, int], level: int
    ) -> None:
        called = self.called(routine, at)
        if called is None or level >= _DEEPEST:
            raise self.refusal(routine, at, condition, opening)
        self.pass_over(called[1], called[1].first, called[1].last, condition, opening, level + 1)

    @staticmethod
    def _says_why(routine: Val3Routine, at: int) -> bool:
        """Return whether a message stands before return in its branch: the end of a job that cannot go on."""
        for line in range(at - 1, routine.first - 1, -1):
            row = row_of(routine.codes[line]) if routine.codes[line] else None
            if row is not None and row.word in ("popUpMsg", "logMsg", "putln", "put"):
                return True
            if line in routine.ends or row is None:
                return False
        return False

    def called(self, routine: Val3Routine, at: int) -> tuple[str, Val3Routine, list[str]] | None:
        """Return the prefix, program file and arguments of a call; None where no file has it."""
        code = routine.codes[at]
        match = CALL.match(code)
        if match is None:
            raise routine.fault(at, "the call is not understood", limit="call part(1)")
        alias, _, name = match[1].rpartition(":")
        prefix = f"{alias}:" if alias else self.store.prefix
        program = self.folder.find(prefix, name, self.store, lambda what, hint: routine.fault(at, what, hint=hint))
        places = arguments(code, match.end(), code.rfind(")"))
        given = [code[a:b] for a, b in places if code[a:b]]
        return None if program is None else (prefix, program, given)

    def act(self, routine: Val3Routine, at: int) -> None:
        """Remember a line that acts on the cell: in the main program, or that of the call."""
        self.acting.append(at + 1 if routine.name == self.main else self.call_line)

    # ---- parts ---------------------------------------------------------------------------------------------

    def block(self, routine: Val3Routine, at: int) -> None:
        """Begin the block of a line."""
        file = "" if routine.name == self.main else routine.name
        self._blocks.append(Block(at + 1, routine.lines[at], (), self.modal("G1"), len(self.motions), 0, file=file))

    def is_output(self, code: str, target: str) -> bool:
        """Return whether an assignment sets an output."""
        name = re.match(r"[A-Za-z_][\w:]*", target)
        if name is not None and self.store.bound(name[0]) is not None:
            return self.store.is_signal(name[0])
        return OUTPUT.match(code) is not None

    def value(self, routine: Val3Routine, at: int, text: str) -> Value:
        """Return the value of an expression of a line. Raises ProgramError: it is none."""
        self.store.where = f"{routine.name}:{at + 1}"
        try:
            return self.store.evaluate(text)
        except ExpressionError as error:
            raise routine.fault(at, str(error), limit="an expression of VAL3", hint="Post the program again") from error

    def put(self, routine: Val3Routine, at: int, target: str, value: Value) -> None:
        """Set a variable. Raises ProgramError: the value does not fit it."""
        self.store.where = f"{routine.name}:{at + 1}"
        try:
            self.store.assign(target, value)
        except ExpressionError as error:
            raise routine.fault(at, str(error), hint="Post the program again") from error

    def _forget(self, routine: Val3Routine, at: int, target: str, condition: Unknown) -> None:
        why = condition.why if condition.why.startswith("set under") else f"set under a condition: {condition.why}"
        self.put(routine, at, target, Unknown(why, condition.where or f"{routine.name}:{at + 1}"))

    def refusal(self, routine: Val3Routine, at: int, condition: Unknown, opening: tuple[str, int]) -> ProgramError:
        """Return the error of a line that runs where an unknown condition holds."""
        word, line = opening
        try:
            known(
                condition, f"whether a statement that matters to motion runs inside {word} (line {line})",
                routine.place(at), text=routine.codes[at], hint=_HINT,
            )  # fmt: skip
        except ProgramError as error:
            return error
        raise AssertionError


def _harmless(row: Statement) -> bool:
    """Return whether a statement may be passed over in a branch that may not be executed."""
    if row.word in ("setFrame", "link", "libLoad"):
        return False
    return row.treatment is Treatment.NEUTRAL or row.word in (*_BRACKETS, "get", "delay", "open", "close")
