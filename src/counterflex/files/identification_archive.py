"""Archive of identifications: one folder for every run, with its inputs as they were, its results, and nothing lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import tomlkit

from counterflex.core import atomic, file_content
from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.files.dataset.manifest import read_manifest
from counterflex.files.identification_file import read_identification

RESULT: Final = "result.json"
INPUTS: Final = "inputs"


@dataclass(frozen=True, eq=False)
class ArchivedRun:
    """One identification of an archive."""

    folder: Path  # Where it is kept
    result: dict[str, Any]  # Content of its ``result.json``


def run_name(date: str, recipe: str, taken: Path) -> str:
    """Name of the folder of a run: date, time and recipe, numbered where there is one already.

    Args:
        date: ``2026-11-21 22:31:05 UTC``.
        taken: Archive in which the name must be new.
    """
    stem = f"{date.removesuffix(' UTC').replace(' ', '_').replace(':', '')}_{recipe}"
    name, number = stem, 1
    while (taken / name).exists():
        number += 1
        name = f"{stem}_{number:02d}"
    return name


def keep_inputs(folder: Path, cell: Path, manifests: Sequence[Path]) -> None:
    """Copy the cell file and the datasets of a run into its folder.

    Args:
        folder: Of the run; gets ``inputs/cell.toml`` and ``inputs/1``, ``inputs/2``, ... with one dataset each.
        manifests: Of the datasets. Files that lie elsewhere than below their manifest are put beside the copy, and
            the copied manifest names them there.
    """
    atomic.write_bytes(folder / INPUTS / "cell.toml", file_content.content(cell))
    for number, path in enumerate(manifests, 1):
        target = folder / INPUTS / str(number)
        moved: dict[str, str] = {}
        for i, file in enumerate(read_manifest(path).files, 1):
            name = PurePosixPath(file.path.replace("\\", "/"))
            inside = not Path(file.path).is_absolute() and ".." not in name.parts
            relative = str(name) if inside else f"file{i}{name.suffix}"
            if not inside:
                moved[file.path] = relative
            atomic.write_bytes(target / relative, file_content.content(path.parent / file.path))
        text = file_content.content(path)
        if moved:
            doc: Any = tomlkit.parse(text.decode("utf-8-sig"))
            for table in doc["files"]:
                table["path"] = moved.get(str(table["path"]), table["path"])
            text = tomlkit.dumps(doc).encode()
        atomic.write_bytes(target / path.name, text)


def runs_below(folder: Path) -> list[ArchivedRun]:
    """All identifications in and below a folder, oldest first; a run that is there twice counts once.

    Raises:
        FileFormatError: The folder does not exist.
    """
    if not folder.is_dir():
        raise FileFormatError("no such folder", where=str(folder))
    results: dict[tuple[str, ...], ArchivedRun] = {}
    # The copy in an archive comes before the one beside it: its name tells which of two in one second was later.
    for path in sorted(folder.rglob(RESULT), key=lambda p: (-len(p.parts), str(p))):
        try:
            result = read_identification(path)
        except CounterflexError:
            continue
        key = (result["date"], result["recipe"], *(d["sha256"] for d in result["data"]), str(result["headline"]))
        results.setdefault(key, ArchivedRun(path.parent, result))
    return sorted(results.values(), key=lambda run: (run.result["date"], run.folder.name))
