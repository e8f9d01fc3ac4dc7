"""Finished steps of long jobs: kept on disk, recognised by a fingerprint of everything they were made from.

A fingerprint has a part for every file, every fact and every room of the program that computes, so that one line can
say why something is made again. What shows results (``cli``, ``report``) does not count.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

import counterflex
from counterflex import __version__
from counterflex.core import atomic
from counterflex.core.errors import FileFormatError

DONE: Final = "done.json"
"""Written last into the folder of a step: its fingerprint, and what the job needs to go on."""
_ROOT: Final = Path(counterflex.__file__).parent
_SHOW: Final = ("cli", "report", "commands")  # Rooms that show results and make none
_NAMED: Final = 4  # Changed parts that a line names; the others are counted

Mark = tuple[tuple[str, str], ...]
"""Fingerprint of a step: what it is made from, and a hash of each, in order."""


def fingerprint(*files: str | Path, **facts: Any) -> Mark:
    """Return what a step is made from: contents of files, plain facts, and this program: its version and its files.

    A TOML file counts by its meaning, table by table; any other by its bytes.

    Args:
        files: Read whole; a file's folder does not matter.
    """
    parts: list[tuple[str, str]] = [("version", __version__)]
    for file in map(Path, files):
        try:
            if file.suffix == ".toml":
                tables = toml_parts(file)
                parts += [(f"{file.name} [{key}]" if key else file.name, value) for key, value in tables.items()]
            else:
                parts.append((file.name, hashlib.sha256(file.read_bytes()).hexdigest()[:16]))
        except OSError as fault:
            raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(file)) from fault
        except ValueError as fault:
            raise FileFormatError(f"not valid TOML: {fault}", where=str(file)) from fault
    parts += [(key, json.dumps(facts[key], sort_keys=True, allow_nan=False)) for key in sorted(facts)]
    return (*parts, *program_files())


def _is_hidden(part: str) -> bool:
    return part.startswith(".") or part == "__pycache__"


@cache
def program_files(package: str = "") -> Mark:
    """SHA-256, 16 hexadecimal digits, of the files of every room of this package that computes, tables included.

    Hidden files do not count: editors and unfinished copies leave them.

    Args:
        package: Another one that is imported: one hash of all that it computes with, nothing where it is a script.
    """
    file_of = (sys.modules[package].__file__ or "") if package else ""
    if package and not file_of.endswith("__init__.py"):
        return ()
    root = Path(file_of).parent if package else _ROOT
    rooms: dict[str, Any] = {}
    for file in sorted(root.rglob("*")):
        place = file.relative_to(root)
        if file.is_file() and place.parts[0] not in _SHOW and not any(map(_is_hidden, place.parts)):
            room = f"code of {package or place.parts[0]}" if package or len(place.parts) > 1 else "code"
            rooms.setdefault(room, hashlib.sha256()).update(place.as_posix().encode() + b"\n" + file.read_bytes())
    return tuple((room, digest.hexdigest()[:16]) for room, digest in sorted(rooms.items()))


def toml_parts(file: Path) -> dict[str, str]:
    """SHA-256, 16 hexadecimal digits, of the meaning of every table of a TOML file; keys outside tables under ``""``.

    Raises:
        ValueError: It is not TOML.
    """
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    tables = {key: value for key, value in data.items() if isinstance(value, dict | list)}
    parts = {key: _hashed(value) for key, value in sorted(tables.items())}
    return {"": _hashed({key: value for key, value in data.items() if key not in tables}), **parts}


def _hashed(value: object) -> str:
    text = json.dumps(value, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def finished(folder: Path, mark: Mark) -> dict[str, Any] | None:
    """Return what a step wrote when it ended, or None where it did not end, or was made from something else."""
    data = _read(folder / DONE)
    result = data.get("found")
    return result if _mark_of(data) == mark and isinstance(result, dict) else None


def why_again(folder: Path, mark: Mark) -> str:
    """Return why a step has to be made again, in words.

    Returns:
        One line; empty where it is kept, was never made, or was interrupted.
    """
    if finished(folder, mark) is not None:
        return ""
    data = _read(folder / DONE)
    if not data:
        return ""
    if "again" in data and "found" not in data:
        return str(data["again"])
    before = _mark_of(data)
    if before is None:
        return "made by a program that did not note from what"
    if before == mark:
        return "what it found is damaged"
    old, new = dict(before), dict(mark)
    changed = [key for key in dict.fromkeys((*new, *old)) if old.get(key) != new.get(key)]
    named = ", ".join(changed[:_NAMED]) or "order of files"
    more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
    return f"changed: {named}{more}"


def begin(folder: Path, mark: Mark | None = None) -> None:
    """Make a step's folder and take away the mark of an earlier, different one.

    Args:
        mark: Its fingerprint now; with it the reason why it is made again is noted.
    """
    folder.mkdir(parents=True, exist_ok=True)
    again = why_again(folder, mark) if mark is not None else ""
    (folder / DONE).unlink(missing_ok=True)
    if again:
        atomic.write_text(folder / DONE, json.dumps({"again": again}, indent=2) + "\n")


def finish(folder: Path, mark: Mark, result: Mapping[str, Any]) -> None:
    """Mark a step as finished.

    Args:
        result: Plain values for those who come after it.
    """
    again = _read(folder / DONE).get("again")
    data = {"made_from": [list(part) for part in mark], "found": dict(result)} | ({"again": again} if again else {})
    atomic.write_text(folder / DONE, json.dumps(data, indent=2, allow_nan=False) + "\n")


def marks_below(folder: Path) -> dict[Path, tuple[int, int]]:
    """Return the marks of all steps below a folder, with what changes when one is written."""
    return {file: (status.st_ino, status.st_mtime_ns) for file in folder.rglob(DONE) for status in (file.stat(),)}


def made_again(folder: Path, before: Mapping[Path, tuple[int, int]]) -> dict[str, int]:
    """Return why steps below a folder were made again lately, and how many for each reason.

    Args:
        before: :func:`marks_below` when the job began; clocks are not asked, a file may be stamped in the future.

    Returns:
        Count by reason, most first.
    """
    files = [file for file, mark in marks_below(folder).items() if before.get(file) != mark]
    reasons = Counter(again for file in files if (again := _read(file).get("again")))
    return dict(reasons.most_common())


def _read(file: Path) -> dict[str, Any]:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}


def _mark_of(data: Mapping[str, Any]) -> Mark | None:
    parts = data.get("made_from")
    if not isinstance(parts, list) or not all(isinstance(part, list) and len(part) == 2 for part in parts):
        return None
    return tuple((str(key), str(value)) for key, value in parts)
