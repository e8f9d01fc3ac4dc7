"""Programs and libraries of a VAL3 application: what a program can call, reached in its folder."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.file_content import content
from counterflex.integrations.staubli.language.read.data_file import DataFile, data_file_of
from counterflex.integrations.staubli.language.read.program_file import Val3Routine
from counterflex.integrations.staubli.language.read.store import Store
from counterflex.programs.source_text import read_text

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
