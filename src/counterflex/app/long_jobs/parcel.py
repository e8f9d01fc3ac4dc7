"""Files as bytes, for workers that share no disk: what a task reads goes to the worker, what it writes comes back."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, Final

from counterflex.core import atomic, file_content
from counterflex.core.errors import FileFormatError, InputError

LARGEST_BYTES: Final = 2**30
"""Files of one task, unpacked: more than any step of a job writes, less than fills a machine's memory."""
_FACTS: Final = "facts.json"
_FILES: Final = "files/"


def name_below(root: Path, path: Path) -> str:
    """Name of a file or folder below a folder, with slashes.

    Raises:
        InputError: It is not below it; nothing else of this machine is sent to workers.
    """
    try:
        return path.absolute().relative_to(root.absolute()).as_posix()
    except ValueError:
        raise InputError(
            "a file of a task lies outside the folder of its job", where=str(path), limit=str(root)
        ) from None


def packed(root: Path, files: Iterable[Path], facts: Mapping[str, Any]) -> bytes:
    """Files and plain facts as the bytes of a ZIP archive.

    Args:
        root: Folder that the names of the files are relative to.
        files: Below it.
        facts: Values that JSON has.

    Raises:
        InputError: A file is not below the folder.
        FileFormatError: A file cannot be read.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr(_FACTS, json.dumps(facts, allow_nan=False))
        for file in files:
            try:
                archive.writestr(_FILES + name_below(root, file), file_content.content(file))
            except OSError as fault:
                raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(file)) from fault
    return data.getvalue()


def unpacked(data: object, root: Path, below: str | None = None) -> dict[str, Any]:
    """Write the files of a parcel below a folder, each whole or not at all, and return its facts.

    Nothing is unpickled, and no file gets out of the folder, whoever made the parcel.

    Args:
        data: As :func:`packed` made it.
        root: Folder that the names are relative to.
        below: Folder below it that all files must lie in; None takes any.

    Raises:
        FileFormatError: It is no such archive, is too large, or a name leads elsewhere.
        OutputError: A file cannot be written.
    """
    if not isinstance(data, bytes):
        raise FileFormatError("a worker answered with something that is no parcel of files", value=type(data).__name__)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(item.file_size for item in archive.infolist())
            if size > LARGEST_BYTES:
                raise FileFormatError("the files of a task are too large", value=f"{size} bytes", limit=LARGEST_BYTES)
            facts = json.loads(archive.read(_FACTS))
            names = [item.filename for item in archive.infolist() if item.filename.startswith(_FILES)]
            targets = [(name, _target(root, name.removeprefix(_FILES), below)) for name in names]
            for name, target in targets:
                atomic.write_bytes(target, archive.read(name))
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as fault:
        if isinstance(fault, FileFormatError):
            raise
        raise FileFormatError("a parcel of files is damaged", value=str(fault)[:80]) from fault
    if not isinstance(facts, dict):
        raise FileFormatError("a parcel of files has no facts")
    return facts


def _target(root: Path, name: str, below: str | None) -> Path:
    parts = PurePosixPath(name).parts
    outside = not parts or ".." in parts or "\\" in name or ":" in name or PurePosixPath(name).is_absolute()
    if outside or (below is not None and parts[: len(PurePosixPath(below).parts)] != PurePosixPath(below).parts):
        raise FileFormatError("a parcel holds a file that is not of its task", value=name, limit=below)
    return root.joinpath(*parts)
