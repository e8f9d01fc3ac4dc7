"""Write results whole or not at all: to a temporary file beside the target, then rename."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from counterflex.core.errors import OutputError


def _refuse(path: Path, fault: OSError) -> OutputError:
    return OutputError(
        f"cannot write: {fault.strerror or fault}",
        where=str(path),
        hint="Choose another --out folder or free space there",
    )


@contextlib.contextmanager
def atomic_path(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the target's folder; rename it onto ``target`` when the block ends well.

    Raises:
        OutputError: The folder cannot be made or written. On any exception the temporary file is removed and an
            existing target is left as it was.
    """
    path = Path(target)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
        os.close(handle)
    except OSError as fault:
        raise _refuse(path, fault) from fault
    part = Path(name)
    try:
        yield part
        part.replace(path)
        umask = os.umask(0)
        os.umask(umask)
        path.chmod(0o666 & ~umask)
    except OSError as fault:
        part.unlink(missing_ok=True)
        raise _refuse(path, fault) from fault
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_text(target: str | os.PathLike[str], text: str, *, newline: str = "\n") -> None:
    """Write text as UTF-8, whole or not at all."""
    with atomic_path(target) as part, part.open("w", encoding="utf-8", newline=newline) as stream:
        stream.write(text)


def write_bytes(target: str | os.PathLike[str], data: bytes) -> None:
    """Write bytes, whole or not at all."""
    with atomic_path(target) as part:
        part.write_bytes(data)


@contextlib.contextmanager
def atomic_folder(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a staging folder; when the block ends well, move each of its files into ``target``.

    Files already in ``target`` under the same names are replaced, others are left alone. On any exception nothing
    in ``target`` changes (a folder that was not there is not made).

    Raises:
        OutputError: The folder cannot be made or written.
    """
    path = Path(target)
    existed = path.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent))
    except OSError as fault:
        raise _refuse(path, fault) from fault
    try:
        yield staging
        path.mkdir(exist_ok=True)
        for item in sorted(staging.rglob("*")):
            if item.is_file():
                destination = path / item.relative_to(staging)
                destination.parent.mkdir(parents=True, exist_ok=True)
                item.replace(destination)
    except OSError as fault:
        if not existed:
            shutil.rmtree(path, ignore_errors=True)
        raise _refuse(path, fault) from fault
    finally:
        shutil.rmtree(staging, ignore_errors=True)
