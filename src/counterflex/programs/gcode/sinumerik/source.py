"""Lines of a Sinumerik program and of its subprograms: labels, block numbers, loops and conditions."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.gcode.read.scanner import error_at
from counterflex.programs.source_text import read_text

_HEAD: Final = re.compile(
    r"\s*(?:/\d?\s*)?(?:(?:N|:)\s*(?P<number>\d+)\s*)?(?P<label>[A-Z_]{1,2}\w*\s*:(?!=))?\s*", re.IGNORECASE
)
_WORDS: Final = (
    "IF", "ELSE", "ENDIF", "FOR", "ENDFOR", "WHILE", "ENDWHILE", "LOOP", "ENDLOOP", "REPEATB", "REPEAT", "UNTIL",
    "GOTOF", "GOTOB", "GOTOC", "GOTOS", "GOTO", "CASE", "DEF", "PROC", "EXTERN",
)  # fmt: skip
_KEYWORD: Final = re.compile(rf"({'|'.join(_WORDS)})(?![\w=])", re.IGNORECASE)
_PROGRAM: Final = re.compile(r"\s*%_N_(\w+?)_(MPF|SPF)\b", re.IGNORECASE)
_JUMP: Final = re.compile(r"\bGOTO[FBCS]?\b", re.IGNORECASE)
_CLOSES: Final = {"ENDIF": "IF", "ENDFOR": "FOR", "ENDWHILE": "WHILE", "ENDLOOP": "LOOP", "UNTIL": "REPEAT"}


@dataclass
class SinumerikConstruct:
    """A loop or condition: its lines by index, ``middle`` that of ELSE."""

    keyword: str
    start: int
    end: int = -1
    middle: int = -1


@dataclass(frozen=True)
class SinumerikHead:
    """Part of a line before its words."""

    keyword: str  # Word of the flow of the program, in capitals; empty where there is none
    label_start: int  # Index of the label; equal to ``label_end`` where there is none
    label_end: int  # Index behind the colon
    rest: int  # Index behind the keyword

    @classmethod
    def of(cls, line: str) -> SinumerikHead:
        """Return what stands before the words of a line."""
        match = _HEAD.match(line)
        assert match is not None
        keyword = _KEYWORD.match(line, match.end())
        start, end = match.span("label") if match["label"] else (match.end(), match.end())
        return cls("" if keyword is None else keyword[1].upper(), start, end, match.end() if keyword is None else
                    keyword.end())  # fmt: skip


def code_of(line: str) -> str:
    """Return a line without its comment, as long as it was."""
    quoted = False
    for index, character in enumerate(line):
        quoted = quoted != (character == '"')
        if character == ";" and not quoted:
            return line[:index]
    return line


@dataclass
class SinumerikSource:
    """A program: lines of a file from ``first`` to before ``last``.

    Raises:
        ProgramError: A loop or condition that is not closed, or closes nothing.
    """

    name: str
    lines: tuple[str, ...]
    first: int
    last: int
    flow: bool = True
    labels: dict[str, list[int]] = field(default_factory=dict)
    at: dict[int, SinumerikConstruct] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Find labels, loops and conditions."""
        opened: list[SinumerikConstruct] = []
        for index in range(self.first, self.last if self.flow else self.first):
            code = code_of(self.lines[index])
            match = _HEAD.match(code)
            if match is None or not code.strip():
                continue
            if match["number"]:
                self.labels.setdefault(f"N{int(match['number'])}", []).append(index)
            if match["label"]:
                self.labels.setdefault(match["label"].rstrip(": \t").upper(), []).append(index)
            self._place(index, code, opened)
        if opened:
            raise self._fault(opened[-1].start, f"{opened[-1].keyword} is never closed")

    def _place(self, index: int, code: str, opened: list[SinumerikConstruct]) -> None:
        head = SinumerikHead.of(code)
        word, rest = head.keyword, code[head.rest :].strip()
        if word in ("FOR", "WHILE", "LOOP") or (word == "IF" and not _JUMP.search(rest)) or (
            word == "REPEAT" and not rest):  # fmt: skip
            construct = SinumerikConstruct(word, index)
            opened.append(construct)
            self.at[index] = construct
        elif word == "ELSE":
            if not opened or opened[-1].keyword != "IF" or opened[-1].middle >= 0:
                raise self._fault(index, "ELSE stands in no IF")
            opened[-1].middle = index
            self.at[index] = opened[-1]
        elif word in _CLOSES:
            if not opened or opened[-1].keyword != _CLOSES[word]:
                raise self._fault(index, f"{word} closes nothing")
            construct = opened.pop()
            construct.end = index
            self.at[index] = construct

    def _fault(self, index: int, what: str) -> Exception:
        return error_at(self.name, index + 1, what, 0, self.lines[index].strip()[:40])

    def target(self, word: str, label: str, index: int) -> int | None:
        """Return the index of a jump's target: forwards, backwards, or forwards and then backwards."""
        key = label.upper()
        if re.fullmatch(r"N\d+", key):
            key = f"N{int(key[1:])}"
        places = self.labels.get(key, [])
        later, earlier = [p for p in places if p > index], [p for p in places if p <= index]
        if word == "GOTOB":
            return earlier[-1] if earlier else None
        if word == "GOTOF":
            return later[0] if later else None
        return later[0] if later else earlier[0] if earlier else None


def programs_of(name: str, text: str, flow: bool = True) -> dict[str, SinumerikSource]:
    """Return the programs of a file by name; one without headers ``%_N_NAME_MPF`` has the name of the file.

    The first one is the main program; it begins with the file.
    """
    lines = split_lines(text)
    heads = [(i, m[1].upper()) for i, line in enumerate(lines) if flow and (m := _PROGRAM.match(line)) is not None]
    if not heads:
        return {Path(name).stem.upper(): SinumerikSource(name, lines, 0, len(lines), flow)}
    if any(code_of(line).strip() for line in lines[: heads[0][0]]):
        heads.insert(0, (0, Path(name).stem.upper()))
    starts = [0, *(index for index, _ in heads[1:]), len(lines)]
    return {
        program: SinumerikSource(name, lines, first, last)
        for (_, program), first, last in zip(heads, starts, starts[1:], strict=False)
    }


Library = Callable[[str], SinumerikSource | None]
"""Returns a subprogram by its name in capitals, or None."""


def library_of(programs: dict[str, SinumerikSource], folder: Path | None) -> Library:
    """Return what finds subprograms: in the file of the program, then in its folder (``.spf``, then ``.mpf``)."""
    known = dict(programs)

    def find(name: str) -> SinumerikSource | None:
        name = re.sub(r"^.*[/\\]", "", name.upper())
        name = re.sub(r"_(SPF|MPF)$|\.(SPF|MPF)$", "", re.sub(r"^_N_", "", name))
        if name not in known and folder is not None:
            for file in sorted(folder.iterdir(), key=lambda file: file.suffix.lower() != ".spf"):
                if file.stem.upper() == name and file.suffix.lower() in (".spf", ".mpf"):
                    programs_there = programs_of(file.name, read_text(file)[0])
                    known[name] = programs_there.get(name, next(iter(programs_there.values())))
                    break
        return known.get(name)

    return find


def no_library(name: str) -> SinumerikSource | None:  # noqa: ARG001
    """Find nothing: a dialect without subprograms."""
    return None
