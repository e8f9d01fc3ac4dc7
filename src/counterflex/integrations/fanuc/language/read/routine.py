"""A listing of a job ready to be executed: its statements with their rows, labels and blocks; the folder it lies in."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.file_content import content
from counterflex.integrations.fanuc.language.program import FanucListing
from counterflex.integrations.fanuc.language.read.listing import Listing, TpStatement
from counterflex.integrations.fanuc.language.read.table import row_of
from counterflex.programs.gcode.read.flow import split_lines
from counterflex.programs.source_text import read_text
from counterflex.programs.statement_table import Statement as Row

POSITION: Final = re.compile(r"P\s*\[\s*(\d+)\s*(?::[^\]]*)?\]", re.IGNORECASE)
_LABEL: Final = re.compile(r"LBL\s*\[\s*(\d+)", re.IGNORECASE)
_CALLED: Final = re.compile(r"\b(?:CALL|RUN)\s+([A-Za-z_][\w-]*)", re.IGNORECASE)
_OPENS: Final = re.compile(r"(IF)\b.*\bTHEN|(FOR)\b.*", re.IGNORECASE | re.DOTALL)
_OF_ARM: Final = re.compile(r"^(U(?:TOOL|FRAME)_NUM)\s*\[\s*GP\s*1\s*\]", re.IGNORECASE)
"""Frame of motion group 1, which is the arm, as the simulator of the maker spells it."""
_CLOSED_BY: Final = {"IF": "ENDIF", "FOR": "ENDFOR"}


def fault(listing: Listing, statement: TpStatement, what: str, *, limit: str | None = None, hint: str | None = None
          ) -> ProgramError:  # fmt: skip
    """Return the error of a statement."""
    value = re.sub(r"\s+", " ", statement.code).strip()[:60]
    return ProgramError(what, where=listing.place(statement.start), value=value, limit=limit, hint=hint)


@dataclass
class TpRoutine:
    """A listing, divided.

    Raises:
        ProgramError: A position is damaged, a block is not closed, or a label stands twice.
    """

    listing: Listing
    lines: tuple[str, ...]
    encoding: str = "utf-8"
    ends: dict[int, int] = field(default_factory=dict)
    elses: dict[int, int] = field(default_factory=dict)
    labels: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Divide it."""
        self.positions = self.listing.positions()
        self.statements = list(self.listing.statements())
        self.texts = [_OF_ARM.sub(r"\1", statement.code.strip()) for statement in self.statements]
        self._match_blocks()

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.listing.name

    @cached_property
    def rows(self) -> list[Row | None]:
        """Row of the table of each statement."""
        return [row_of(text) for text in self.texts]

    def about(self) -> FanucListing:
        """Return what a program keeps of it."""
        mentions: dict[int, int] = {}
        for statement in self.statements:
            for match in POSITION.finditer(statement.code):
                mentions[int(match[1])] = mentions.get(int(match[1]), 0) + 1
        listing = self.listing
        return FanucListing(listing.text, self.positions, mentions, listing.main, listing.behind, listing.has_positions)

    def _match_blocks(self) -> None:
        open_blocks: list[tuple[str, int]] = []
        for at, text in enumerate(self.texts):
            upper = text[:6].upper()
            if (label := _LABEL.match(text)) is not None:
                if int(label[1]) in self.labels:
                    raise fault(self.listing, self.statements[at], f"LBL[{label[1]}] is there twice", limit="once")
                self.labels[int(label[1])] = at
            elif (match := _OPENS.fullmatch(text)) is not None:
                open_blocks.append(((match[1] or match[2]).upper(), at))
            elif upper in ("ENDIF", "ENDFOR"):
                if not open_blocks or _CLOSED_BY[open_blocks[-1][0]] != upper:
                    raise fault(self.listing, self.statements[at], f"{upper} closes nothing",
                                hint="The file may be damaged")  # fmt: skip
                begin = open_blocks.pop()[1]
                self.ends[begin], self.ends[at] = at, begin
            elif text.upper() == "ELSE":
                if not open_blocks or open_blocks[-1][0] != "IF":
                    raise fault(self.listing, self.statements[at], "this belongs into IF",
                                hint="The file may be damaged")  # fmt: skip
                self.elses[open_blocks[-1][1]] = at
                self.elses[at] = open_blocks[-1][1]
        if open_blocks:
            word, at = open_blocks[-1]
            raise fault(self.listing, self.statements[at], f"{word} is not closed", hint="The file may be cut off")


class TpFolder:
    """Listings that a program can call."""

    def __init__(self, files: Iterable[Path] = (), *, complete: bool = True) -> None:
        self._files, self._complete = list(files), complete
        self.routines: dict[str, TpRoutine] = {}

    def find(self, name: str, refuse: Callable[[str, str], ProgramError]) -> TpRoutine | None:
        """Return the listing of a program; None where the folder has none.

        Raises:
            ProgramError: Several files have the name, or it cannot be read.
        """
        own = sorted((file for file in self._files if file.stem.upper() == name.upper()), key=str)
        if len(own) > 1:
            raise refuse(
                f"several files of the folder are called {name}", f"Keep one of {', '.join(f.name for f in own)}"
            )
        if not own:
            return None
        file = own[0].name
        if file not in self.routines:
            text, encoding = read_text(own[0])
            self.routines[file] = TpRoutine(Listing(text, file, complete=self._complete), split_lines(text), encoding)
        return self.routines[file]


def listings_beside(program: Path) -> list[Path]:
    """Return the other listings of a program's folder."""
    if not program.parent.is_dir():
        return []
    return [file for file in program.parent.iterdir() if file.suffix.lower() == ".ls" and file.is_file()
            and file.name != program.name]  # fmt: skip


def job_files(program: Path) -> tuple[Path, ...]:
    """Return the listings of a program's folder that it names in CALL or RUN, and those that they name."""
    listings = {file.stem.upper(): file for file in listings_beside(program)}
    reached: dict[str, Path] = {}
    open_files = [program]
    while open_files:
        file = open_files.pop()
        text = content(file).decode("latin-1") if file.is_file() else ""
        for match in _CALLED.finditer(text):
            name = match[1].upper()
            if name in listings and name not in reached:
                reached[name] = listings[name]
                open_files.append(listings[name])
    return tuple(reached[name] for name in sorted(reached))
