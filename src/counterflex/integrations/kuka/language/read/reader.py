"""Read KUKA KRL jobs strictly: what cannot be known exactly is refused with its line and what to do."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.file_content import content
from counterflex.integrations.kuka.language.program import KrlProgram
from counterflex.integrations.kuka.language.read.frames import KrlCell
from counterflex.integrations.kuka.language.read.interpreter import KrlInterpreter
from counterflex.integrations.kuka.language.read.job import KrlJob, kept_of, text_in
from counterflex.programs.program import same_motions
from counterflex.programs.source_text import read_text

_SENSOR_ON: Final = re.compile(r"\bRSI_ON\s*\(", re.IGNORECASE)
_SUFFIXES: Final = (".src", ".dat")
_WORD: Final = re.compile(r"[A-Za-z_$]\w*")
_PUBLIC: Final = re.compile(
    r"^\s*(?:DEFDAT\s+(?:\$CONFIG|\w+\s+PUBLIC)|GLOBAL\s+DEF(?:FCT)?)\b", re.IGNORECASE | re.MULTILINE
)


def read_krl(
    text: str,
    *,
    name: str = "program.src",
    data: str | None = None,
    data_name: str = "program.dat",
    folder: Mapping[str, str] | None = None,
    cell: KrlCell | None = None,
    complete: bool = True,
) -> KrlProgram:
    """Execute a job's text and return the lines passed and the motions made.

    Positions are of the tool tip in the part frame; the tool axis and the rotation about it are those
    of ``R = Rz(A) Ry(B) Rx(C)``. A program that keeps the tool along z of the part has motions without rotary angles;
    another one has the components of the tool axis there, see :data:`~counterflex.programs.program.TOOL_VECTOR`. The
    first Cartesian target is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        text: The ``.src`` file of the main program.
        data: The ``.dat`` file of the same name; None where there is none.
        folder: Text of the other files of its folder, by name: those that it calls and public data lists are read.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
        complete: Refuse a text without END: it may have been cut off.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    others = {} if folder is None else folder
    if data is not None:
        same = Path(data_name).stem.upper() == Path(name).stem.upper()
        others = {**others, data_name if same else f"{Path(name).stem}.dat": data}
    job = KrlJob(name, text, others)
    interpreter = KrlInterpreter(job, cell, complete=complete)
    interpreter.run()
    _check_next_run(interpreter, KrlInterpreter(KrlJob(name, text, others), cell, complete=complete))
    main = job.main.file
    external = interpreter.targets.external.changes(interpreter.motions)
    return KrlProgram(
        **{
            **interpreter.fields(name, main.text),
            "lines": main.lines,
            "newline": main.newline,
            "acting": tuple(dict.fromkeys(interpreter.acting)),
        },
        dialect="krl",
        straight=len({(move.file, move.line) for move in interpreter.moves}) == len(interpreter.moves),
        files=dict(job.files),
        moves=tuple(interpreter.moves),
        R_tcp_tool=interpreter.frames.R_tcp_tool,
        extra="" if external else interpreter.targets.extra_text,
        external=external,
        loose_triggers=interpreter.loose,
        reads_position=interpreter.reads_position,
    )


def _check_next_run(first: KrlInterpreter, again: KrlInterpreter) -> None:
    """Refuse a job that moves otherwise when it is run again, because its data lists keep what it changes."""
    kept = kept_of(first.memory.lists)
    if not kept:
        return
    again.memory.kept_from = kept
    again.run()
    if not same_motions(first.motions, again.motions, first.rotations, again.rotations):
        file, name, _ = next(iter(kept))
        raise ProgramError(
            "the next run of the program makes other motions: data lists keep what a run changes", where=file,
            value=", ".join(dict.fromkeys(name for _, name, _ in kept))[:60], limit="the same motions in every run",
            hint=f"Give {name} its value in the program before it is used, or declare it there",
        )  # fmt: skip


def read_krl_file(path: str | os.PathLike[str], *, cell: KrlCell | None = None, complete: bool = True) -> KrlProgram:
    """Read a ``.src`` file, with the ``.dat`` file of the same name and what it calls in its folder.

    Args:
        path: The ``.src`` file, UTF-8 or Latin-1.
        cell: See :func:`read_krl`.
        complete: Refuse a file without END.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no program that can be executed exactly.
    """
    file = Path(path)
    text, encoding = _decoded(file)
    folder = KrlFolder(file, encoding)
    program = read_krl(text, name=file.name, folder=folder, cell=cell, complete=complete)
    if any(folder.encodings.get(name, encoding) != encoding for name in program.files):
        folder = KrlFolder(file, "latin-1", only=True)
        text = content(file).decode("latin-1")
        program = read_krl(text, name=file.name, folder=folder, cell=cell, complete=complete)
        encoding = "latin-1"
    return replace(program, encoding=encoding)


def job_files(path: Path) -> tuple[Path, ...]:
    """Return the files of the folder that a program may use: those that it names, and public data lists.

    Args:
        path: The ``.src`` file; where it cannot be read there are none.
    """
    try:
        text, encoding = _decoded(path)
        folder = KrlFolder(path, encoding)
        taken: dict[str, None] = {}
        texts = [(path.stem, text)]
        while texts:
            stem, text = texts.pop()
            words = {word.upper() for word in _WORD.findall(text)}
            for name in folder:
                own, suffix = PurePath(name).stem.upper(), PurePath(name).suffix.lower()
                names_it = own in words or (suffix == ".dat" and own == stem.upper())
                if name not in taken and (names_it or _shares(text_in(folder, name), words)):
                    taken[name] = None
                    texts.append((PurePath(name).stem, text_in(folder, name)))
    except (OSError, ProgramError):
        return ()
    return tuple(folder.path(name) for name in taken)


def _shares(text: str, words: set[str]) -> bool:
    """Return whether a file gives one of these names to every program."""
    if _PUBLIC.search(text) is None:
        return False
    return not words.isdisjoint(word.upper() for word in _WORD.findall(text))


class KrlFolder(Mapping[str, str]):
    """Text of the ``.src`` and ``.dat`` files beside a program or in its archive, read when it is asked for."""

    def __init__(self, program: Path, encoding: str, *, only: bool = False) -> None:
        self._only = encoding if only else ""
        self._paths: dict[str, Path] = {}
        for file in (*sorted(program.parent.iterdir()), *_of_archive(program.resolve())):
            if file.suffix.lower() in _SUFFIXES and file.name != program.name and file.is_file():
                self._paths.setdefault(file.name, file)
        self._texts: dict[str, str] = {}
        self.encodings: dict[str, str] = {}

    def __getitem__(self, name: str) -> str:
        """Text of a file."""
        if name not in self._texts:
            file = self._paths[name]
            if self._only:
                self._texts[name] = content(file).decode(self._only)
            else:
                self._texts[name], self.encodings[name] = _decoded(file)
        return self._texts[name]

    def __iter__(self) -> Iterator[str]:
        """Names."""
        return iter(self._paths)

    def __len__(self) -> int:
        """Number of files."""
        return len(self._paths)

    def path(self, name: str) -> Path:
        """Return where a file lies."""
        return self._paths[name]


def _of_archive(program: Path) -> Iterator[Path]:
    """Files that a program in ``R1/Program`` of an archive of the controller may use, in other folders of it."""
    # The controller finds programs by name in all folders of ``R1/Program``, and its own data in ``R1/System``.
    root = next((folder for folder in program.parents if folder.name.upper() == "R1"), None)
    if root is None:
        return
    folders = {folder.name.upper(): folder for folder in root.iterdir() if folder.is_dir()}
    if "PROGRAM" in folders:
        yield from sorted(folders["PROGRAM"].rglob("*"))
    if "SYSTEM" in folders:
        yield from (file for file in sorted(folders["SYSTEM"].iterdir()) if file.name.lower() == "$config.dat")


def _decoded(file: Path) -> tuple[str, str]:
    text, encoding = read_text(file)
    if encoding == "utf-8-sig":
        raise ProgramError(
            "the file begins with a byte order mark, which no KUKA controller reads", where=str(file),
            hint="Save it as ASCII or Latin-1, or as UTF-8 without a mark",
        )  # fmt: skip
    return text, encoding


def corrected_by_sensor(program: KrlProgram) -> list[str]:
    """Return one sentence where a sensor corrects the path."""
    block = next((one for one in program.blocks if _SENSOR_ON.search(one.text.split(";")[0])), None)
    if block is None:
        return []
    place = block.where(Path(program.name).name)
    return [f"{place}: RSI_ON lets a sensor correct the path; what it adds is not looked at"]
