"""Read ABB RAPID programs strictly: what cannot be known exactly is refused with its line and what to do.

Files of a RAPID program: its module, and the modules of the folder that it uses.

The controller loads what the ``.pgf`` names and its system modules. Without one, a module belongs to the program if the
program calls a routine of it, or uses data that it alone declares.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from counterflex.core.errors import ProgramError
from counterflex.core.file_content import content
from counterflex.integrations.abb.language.program import RapidProgram
from counterflex.integrations.abb.language.read.frames import RapidCell
from counterflex.integrations.abb.language.read.interpreter import RapidInterpreter, replaced
from counterflex.integrations.abb.language.read.memory import LAST_RUN
from counterflex.integrations.abb.language.read.routines import Modules
from counterflex.integrations.abb.language.read.scanner import FilePart, RapidSource
from counterflex.programs.program import same_motions
from counterflex.programs.source_text import read_text, refuse_mark

MODULES: Final = (".mod", ".modx", ".prg", ".sys", ".sysx")
_SYSTEM: Final = (".sys", ".sysx")
_LISTED: Final = re.compile(r"<Module>\s*([^<]+?)\s*</Module>", re.IGNORECASE)
_COMMENT: Final = re.compile(r'"(?:[^"\n]|"")*"|![^\r\n]*|%%%.*?%%%', re.DOTALL)
_MODULE: Final = re.compile(r"^\s*MODULE\s+(\w+)", re.IGNORECASE | re.MULTILINE)
_ROUTINE: Final = re.compile(
    r"^[^\S\r\n]*(LOCAL\s+)?(?:(?:PROC|TRAP)\s+|FUNC\s+\w+\s+)(\w+)", re.IGNORECASE | re.MULTILINE
)
_DATA: Final = re.compile(
    r"^[^\S\r\n]*(LOCAL\s+)?(?:TASK\s+|GLOBAL\s+)?(?:CONST|PERS|VAR)\s+\w+\s+(\w+)", re.IGNORECASE | re.MULTILINE
)
_BODY: Final = re.compile(r"\b(?:PROC|TRAP|FUNC)\b.*?\bEND(?:PROC|TRAP|FUNC)\b", re.IGNORECASE | re.DOTALL)
_NAME: Final = re.compile(r"(?<![\w.\\])[A-Za-z]\w*")
_LATE: Final = re.compile(r'%\s*"(\w+)|CallByVar\s*"(\w+)', re.IGNORECASE)
_LOADED: Final = re.compile(r'"([^"\r\n]*?([^/\\:"\r\n]+\.(?:mod|modx|prg|sys|sysx)))"', re.IGNORECASE)
_LARGEST: Final = 50_000_000
_LITERALS: Final = re.compile(r"\[[-+\d.,Ee\s\[\]]*\]")


@dataclass(frozen=True)
class _Index:
    """Names of a module: its own, of global routines and data, those that it uses, calls late, and loads as files."""

    file: Path
    module: str
    routines: frozenset[str]
    data: frozenset[str]
    own: frozenset[str]
    used: frozenset[str]
    late: frozenset[str]
    loaded: frozenset[str]

    def required(self) -> frozenset[str]:
        return (self.used | self.late) - self.own

    def used_with(self, taken: frozenset[str], others: list[_Index]) -> list[_Index]:
        """Modules that it uses: by names that none has yet, by loading, by the beginning of their routines' names."""
        fitting = [one for one in others if not (one.routines | one.data) & taken]
        used: list[_Index] = []
        for name in sorted(self.required() - taken):
            used += _holder(name, self, fitting)
        named = self.loaded | self.late
        used += [one for one in others if one.file.name.upper() in named or one.module in named]
        numbered = [re.compile(rf"{re.escape(name)}_?\d+") for name in self.late]
        return used + [one for one in fitting if any(test.fullmatch(n) for test in numbered for n in one.routines)]


def modules_of(file: Path) -> list[Path]:
    """Return the files of a program, that of the program itself first.

    Raises:
        ProgramError: A file is missing, or which one is meant is not known.
    """
    if file.suffix.lower() == ".pgf":
        first, *others = _main_first(_listed(file), file)
        return [first, *others, *_used_systems(first, others)]
    lists = _lists_with(file)
    if len(lists) > 1:
        shown = {tuple(sorted(path.name.upper() for path in _listed(one))) for one in lists}
        if len(shown) > 1:
            raise ProgramError(
                "the module stands in several programs", where=str(file),
                value=", ".join(path.name for path in lists)[:60], limit="one .pgf that names it",
                hint="Give the .pgf itself",
            )  # fmt: skip
    if lists:
        others = [path for path in _listed(lists[0]) if path.name.upper() != file.name.upper()]
        return [file, *others, *_used_systems(file, others)]
    return _closure(file)


def companion_modules(file: Path) -> tuple[Path, ...]:
    """Return the other files of a program, none where they cannot be told."""
    try:
        return tuple(path for path in modules_of(file) if path != file)
    except ProgramError:
        return ()


def joined(files: Sequence[Path]) -> tuple[str, str, tuple[FilePart, ...]]:
    """Return the text of files one after the other, its encoding, and where each stands in it."""
    read = [read_text(file) for file in files]
    encodings = {encoding for _, encoding in read}
    if len(encodings) > 1:
        read = [(content(file).decode("latin-1"), "latin-1") for file in files]
    parts, at, line, texts = [], 0, 0, []
    for file, (text, _) in zip(files, read, strict=True):
        parts.append(FilePart(file.name, at, at + len(text), line))
        text += "" if text.endswith(("\n", "\r")) or len(files) == 1 else "\n"
        texts.append(text)
        at += len(text)
        line += len(re.findall(r"\r\n|\n|\r", text))
    return "".join(texts), read[0][1], tuple(parts)


def _listed(file: Path) -> list[Path]:
    """Modules that a ``.pgf`` names."""
    text, _ = read_text(file)
    names = _LISTED.findall(text)
    if not names:
        raise ProgramError(
            "the program list names no module", where=str(file), limit="<Module>NAME.mod</Module>",
            hint="Save the program again, or give the module itself",
        )  # fmt: skip
    return [_listed_file(file, name) for name in names]


def _listed_file(file: Path, name: str) -> Path:
    last = re.split(r"[/\\:]", name)[-1]
    match = next((path for path in _folder(file) if path.name.upper() == last.upper()), None)
    if match is None:
        raise ProgramError(
            "a module of the program is missing", where=str(file), value=last, limit="a file in the same folder",
            hint="Put it beside the program list",
        )  # fmt: skip
    return match


def _folder(file: Path) -> list[Path]:
    """Files of the folder; of a backup, whose programs lie in PROGMOD, those of SYSMOD beside it too."""
    here = file.resolve().parent
    folders = [here, here.parent / "SYSMOD"] if here.name.upper() == "PROGMOD" else [here]
    out: list[Path] = []
    for folder in folders:
        try:
            out += sorted(path for path in folder.iterdir() if path.is_file())
        except OSError:
            continue
    return out


def _lists_with(file: Path) -> list[Path]:
    """Program lists of the folder that name a module."""
    out = []
    for path in _folder(file):
        if path.suffix.lower() == ".pgf" and path.stat().st_size < _LARGEST:
            names = [re.split(r"[/\\:]", name)[-1].upper() for name in _LISTED.findall(read_text(path)[0])]
            if file.name.upper() in names:
                out.append(path)
    return out


def _main_first(files: list[Path], where: Path) -> list[Path]:
    mains = [file for file in files if "MAIN" in _index(file).routines]
    if len(mains) != 1:
        raise ProgramError(
            "which module is the program is not known", where=str(where),
            value=", ".join(file.name for file in mains)[:60] or "none", limit="one module with PROC main()",
            hint="Give the module itself",
        )  # fmt: skip
    return [mains[0], *(file for file in files if file != mains[0])]


def _used_systems(file: Path, others: Iterable[Path]) -> list[Path]:
    """System modules of the folder that the modules of a program use."""
    chosen = [_index(file), *map(_index, others)]
    systems = [_index(path) for path in _folder(file) if path.suffix.lower() in _SYSTEM]
    return [one.file for one in _grown(chosen, systems)][len(chosen) :]


def _closure(file: Path) -> list[Path]:
    """A module and those of its folder that it uses."""
    first = _index(file)
    if not first.own:
        return [file]
    candidates = [
        path
        for path in _folder(file)
        if path.suffix.lower() in MODULES and path.name != file.name and path.stat().st_size < _LARGEST
    ]
    if not candidates or not first.required():
        return [file]
    return [one.file for one in _grown([first], [_index(path) for path in candidates])]


def _grown(chosen: list[_Index], candidates: list[_Index]) -> list[_Index]:
    """Modules with those added that they use, again and again; names that stand in several are left out."""
    while True:
        taken = frozenset().union(*(one.routines | one.data for one in chosen))
        others = [one for one in candidates if one not in chosen]
        added = {one.file: one for asking in chosen for one in asking.used_with(taken, others)}
        if not added:
            return chosen
        chosen = [*chosen, next(iter(added.values()))]


def _holder(name: str, asking: _Index, candidates: list[_Index]) -> list[_Index]:
    """The module that declares a name; none where none does."""
    routines = [one for one in candidates if name in one.routines]
    if len(routines) > 1:
        raise ProgramError(
            f"the routine {name.lower()} stands in several modules of the folder", where=str(asking.file),
            value=", ".join(one.file.name for one in routines)[:60], limit="one module",
            hint="Name the modules of the program in a .pgf, or take the others out of the folder",
        )  # fmt: skip
    data = [one for one in candidates if name in one.data]
    return routines or (data if len(data) == 1 else [])


def _index(file: Path) -> _Index:
    text, _ = read_text(file)
    code = _COMMENT.sub(lambda match: '""' if match[0].startswith('"') else " ", text)
    empty: frozenset[str] = frozenset()
    head = _MODULE.search(code)
    if head is None:
        return _Index(file, "", empty, empty, empty, empty, empty, empty)
    routines = [(bool(match[1]), match[2].upper()) for match in _ROUTINE.finditer(code)]
    outside = _BODY.sub(" ", code)
    data = [(bool(match[1]), match[2].upper()) for match in _DATA.finditer(outside)]
    inner = {match[2].upper() for match in _DATA.finditer(code)}
    own = {name for _, name in (*routines, *data)} | inner
    used = {match.upper() for match in _NAME.findall(_LITERALS.sub("[]", code))}
    late = {(match[1] or match[2]).upper() for match in _LATE.finditer(text)}
    loaded = {match[2].upper() for match in _LOADED.finditer(text)}
    return _Index(
        file, head[1].upper(), frozenset(name for local, name in routines if not local),
        frozenset(name for local, name in data if not local), frozenset(own), frozenset(used), frozenset(late),
        frozenset(loaded),
    )  # fmt: skip


def read_rapid(
    text: str,
    *,
    name: str = "program.mod",
    cell: RapidCell | None = None,
    complete: bool = True,
    parts: Sequence[FilePart] = (),
) -> RapidProgram:
    """Execute the text of modules and return the statements passed and the motions made.

    Positions are of the tool tip in the work object, which is the part frame; the tool axis and the rotation about it
    are those of the quaternion. A program that keeps the tool along z of the part has motions without rotary angles;
    another one has the components of the tool axis there, see :data:`~counterflex.programs.program.TOOL_VECTOR`. The
    first target is approached from wherever the robot is: it counts as reached by a rapid without length.

    Args:
        text: The modules, one after the other; that of the program first.
        name: File of the program, for errors.
        cell: What frames and process words are checked against; None takes every frame and knows no process words.
        complete: Refuse a text without ENDMODULE: it may have been cut off.
        parts: Place of each file in the text; none: it is one file.

    Returns:
        The program as executed: ``PROC main``, or the only routine that no other calls.

    Raises:
        ProgramError: With ``name:line:column``, at the first thing that is unknown, contradictory or cannot be read
            exactly.
    """
    source = RapidSource(text, name, parts)
    modules = Modules(source, complete=complete)
    interpreter = _executed(source, modules, cell)
    starts = [move.start for move in interpreter.moves]
    main = text[: source.parts[0].end]
    return RapidProgram(
        **interpreter.fields(name, main),
        dialect="rapid",
        straight=len(set(starts)) == len(starts),
        external=interpreter.targets.external.changes(interpreter.motions),
        text=text,
        files=tuple((part.name, part.start, part.end) for part in source.parts),
        moves=tuple(interpreter.moves),
        calls=tuple(replaced(interpreter.calls)),
        declarations=modules.modules[0].declarations,
        names=frozenset(name for module in modules.modules for name in (*module.data, *module.routines)),
    )


def _executed(source: RapidSource, modules: Modules, cell: RapidCell | None) -> RapidInterpreter:
    """Return the program as executed."""
    # Persistent data that it changes begins with what the last run left. If that matters, the program is executed from
    # the declared values, and again from what this run leaves: it is known if both runs do the same and leave the same.
    try:
        return _run(source, modules, cell, None)
    except ProgramError as fault:
        if LAST_RUN not in str(fault):
            raise
        try:
            first = _run(source, modules, cell, {})
            left = first.memory.kept()
            again = _run(source, modules, cell, left)
        except ProgramError:
            raise fault from None
        if (
            not left
            or again.memory.kept() != left
            or not same_motions(first.motions, again.motions, first.rotations, again.rotations)
        ):
            raise
        return first


def _run(
    source: RapidSource, modules: Modules, cell: RapidCell | None, kept_from: Mapping[int, object] | None
) -> RapidInterpreter:
    first = RapidInterpreter.executed(source, modules, cell, "", kept_from)
    objects = first.frames.objects
    if len(objects) < 2:
        return first
    try:  # without a cell: most motions are in the part frame
        return RapidInterpreter.executed(source, modules, cell, max(objects, key=lambda key: objects[key]), kept_from)
    except ProgramError:  # that frame begins unknown, because the program itself changes it
        return first


def read_rapid_file(
    path: str | os.PathLike[str], *, cell: RapidCell | None = None, complete: bool = True
) -> RapidProgram:
    """Read a program: a module with those of its folder that it uses, or the modules of a ``.pgf``.

    Args:
        path: The file, UTF-8 or Latin-1.
        cell: See :func:`read_rapid`.
        complete: Refuse a file without ENDMODULE.

    Raises:
        ProgramError: A file cannot be read, is no text, or is no program that can be executed exactly.
    """
    files = modules_of(Path(path))
    text, encoding, parts = joined(files)
    refuse_mark(encoding, files[0], "not every controller reads")
    program = read_rapid(text, name=files[0].name, cell=cell, complete=complete, parts=parts)
    return replace(program, encoding=encoding)
