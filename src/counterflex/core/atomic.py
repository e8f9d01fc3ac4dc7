"""Write results whole or not at all: to a temporary file beside the target, then rename."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from counterflex.core.errors import OutputError

_OTHER = "Choose another --out or make room there"


def _refuse(path: Path, fault: OSError) -> OutputError:
    return OutputError(
        f"cannot write: {fault.strerror or fault}",
        where=str(path),
        hint=_OTHER,
    )


@contextlib.contextmanager
def _parents_of(path: Path) -> Iterator[None]:
    """Make the folders above a path; on any exception those that were not there before are removed again."""
    made: list[Path] = []
    try:
        for folder in reversed(path.parents):
            if not folder.exists():
                folder.mkdir(exist_ok=True)
                made.append(folder)
        yield
    except BaseException:
        for folder in reversed(made):
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def _usual_mode(path: Path, mode: int) -> None:
    """Give a temporary file or folder the rights it would have had if made in the usual way."""
    umask = os.umask(0)
    os.umask(umask)
    path.chmod(mode & ~umask)


@contextlib.contextmanager
def atomic_path(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the target's folder; rename it onto ``target`` when the block ends well.

    Raises:
        OutputError: The folder cannot be made or written. On any exception the temporary file is removed, and so are
            folders made for it; an existing target is left as it was.
    """
    path = Path(target)
    if path.is_dir():
        raise OutputError("cannot write: a folder has this name", where=str(path), hint="Choose another file name")
    try:
        with _parents_of(path):
            handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
            os.close(handle)
            part = Path(name)
            try:
                yield part
                _usual_mode(part, 0o666)
                part.replace(path)
            finally:
                part.unlink(missing_ok=True)
    except OutputError:
        raise
    except OSError as fault:
        raise _refuse(path, fault) from fault


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
    in ``target`` changes, and a folder that was not there is not made. That ``target`` can be written is found out
    before the block begins, so that no long job is done in vain.

    Raises:
        OutputError: The folder cannot be made or written.
    """
    path = Path(target)
    if path.exists() and not path.is_dir():
        raise OutputError("cannot write: a file has the name of the folder", where=str(path), hint=_OTHER)
    try:
        with _parents_of(path):
            inside = path if path.exists() else path.parent
            staging = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".part", dir=inside))
            try:
                yield staging
                if path.exists():
                    _move_into(path, staging)
                else:
                    _usual_mode(staging, 0o777)
                    staging.replace(path)
            finally:
                shutil.rmtree(staging, ignore_errors=True)
    except OutputError:
        raise
    except OSError as fault:
        raise _refuse(path, fault) from fault


def _move_into(path: Path, staging: Path) -> None:
    """Move every file of a staging folder to its place; on any exception everything is put back as it was."""
    files = [item.relative_to(staging) for item in sorted(staging.rglob("*")) if item.is_file()]
    done: list[tuple[Path, Path | None]] = []
    with contextlib.ExitStack() as parents:
        kept = Path(tempfile.mkdtemp(dir=staging))
        try:
            for number, name in enumerate(files):
                destination, before = path / name, None
                parents.enter_context(_parents_of(destination))
                if destination.is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} is a folder there")
                if destination.exists():
                    before = kept / str(number)
                    done.append((destination, before))
                    destination.replace(before)
                else:
                    done.append((destination, None))
                (staging / name).replace(destination)
        except BaseException:
            for destination, before in reversed(done):
                if before is None:
                    destination.unlink(missing_ok=True)
                elif before.exists():
                    before.replace(destination)
            raise
