"""Write results whole or not at all: to a temporary file beside the target, then rename; devices are written into."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

from counterflex.core.errors import CounterflexError, OutputError
from counterflex.core.output_place import SUFFIX, Place, clear_leftovers, part_prefix, place_of
from counterflex.core.system_fault import FULL, system_fault

_OTHER = "Choose another place"


@contextlib.contextmanager
def _refused_in_one_line(path: Path) -> Iterator[None]:
    """Raise what the system or a library says of a target that takes no data as one :class:`OutputError`."""
    try:
        yield
    except (CounterflexError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as fault:  # a panic in Rust is no Exception
        known = system_fault(fault)
        if known is None and not isinstance(fault, OSError):
            raise
        raise _refusal(path, known or OSError(0, str(fault))) from fault


def _refusal(path: Path, fault: OSError) -> OutputError:
    return OutputError(
        f"cannot write: {fault.strerror}",
        where=str(path),
        hint=f"Make room there, or {_OTHER[0].lower()}{_OTHER[1:]}" if fault.errno in FULL else _OTHER,
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


@contextlib.contextmanager
def atomic_path(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path; what is written there takes the place of ``target`` when the block ends well.

    A regular file is replaced by a rename in its own folder and keeps its mode and owner; a symbolic link stays, the
    file that it leads to is replaced. A device, a pipe or an open descriptor (``/dev/stdout``) stays what it is: the
    finished file is written into it.

    Raises:
        OutputError: The folder cannot be made or written, or the target does not take the data. On any exception the
            temporary file is removed, and so are folders made for it; an existing target is left as it was.
    """
    path = Path(target)
    if path.is_dir():
        raise OutputError("cannot write: a folder has this name", where=str(path), hint="Choose another file name")
    with _refused_in_one_line(path):
        place = place_of(path)
        if place.through:
            with tempfile.TemporaryDirectory() as folder:
                part = Path(folder) / path.name
                part.touch()
                yield part
                place.pour(part)
            return
        with _parents_of(place.path):
            part = _part_of(place)
            try:
                yield part
                place.keep_rights(part, 0o666)
                part.replace(place.path)
            finally:
                part.unlink(missing_ok=True)


def _part_of(place: Place) -> Path:
    """An empty temporary file beside the place that it is made for."""
    clear_leftovers(place.path.parent, place.path.name)
    handle, name = tempfile.mkstemp(prefix=part_prefix(place.path.name), suffix=SUFFIX, dir=place.path.parent)
    os.close(handle)
    return Path(name)


def write_text(target: str | os.PathLike[str], text: str, *, newline: str = "\n") -> None:
    """Write text as UTF-8, whole or not at all."""
    with atomic_path(target) as part, part.open("w", encoding="utf-8", newline=newline) as stream:
        stream.write(text)


def write_bytes(target: str | os.PathLike[str], data: bytes) -> None:
    """Write bytes, whole or not at all."""
    with atomic_path(target) as part:
        part.write_bytes(data)


def write_made(target: str | os.PathLike[str], make: Callable[[BinaryIO], object]) -> None:
    """Write what a library makes, whole or not at all.

    The library writes into memory: what it raises at a full disk names neither the disk nor the file (polars: "Invalid
    thrift: transport error").

    Args:
        target: File.
        make: Writes the content into the stream that it is given.
    """
    stream = io.BytesIO()
    make(stream)
    with atomic_path(target) as part, part.open("wb") as file:
        file.write(stream.getbuffer())


@contextlib.contextmanager
def open_record(target: str | os.PathLike[str], *, encoding: str = "utf-8") -> Iterator[TextIO]:
    """Open a record that grows while a job runs and is kept however the job ends, line ends as written.

    A regular file begins anew, behind links too; devices, pipes and descriptors are written into.

    Raises:
        OutputError: It cannot be made, or does not take what is written.
    """
    path = Path(target)
    with _refused_in_one_line(path):
        stream = place_of(path).opened(encoding)
    try:
        with stream:
            yield stream
    except OSError as fault:
        known = system_fault(fault)
        if isinstance(fault, OutputError) or known is None or known.errno not in FULL:  # another's: of a socket, say
            raise
        raise _refusal(path, known) from fault


@contextlib.contextmanager
def atomic_folder(target: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a staging folder; when the block ends well, move each of its files into ``target``.

    Files already in ``target`` under the same names are replaced, others are left alone. On any exception nothing
    in ``target`` changes, and a folder that was not there is not made. That ``target`` can be written is found out
    before the block begins, so that no long job is done in vain. Links and devices in ``target`` are treated as
    :func:`atomic_path` treats them.

    Raises:
        OutputError: The folder cannot be made or written.
    """
    path = Path(target)
    if path.exists() and not path.is_dir():
        raise OutputError("cannot write: a file has the name of the folder", where=str(path), hint=_OTHER)
    if path.is_symlink():
        path = Path(os.path.realpath(path))
    with _refused_in_one_line(path), _parents_of(path):
        inside = path if path.exists() else path.parent
        for folder in {inside, path.parent}:
            clear_leftovers(folder, path.name)
        staging = Path(tempfile.mkdtemp(prefix=part_prefix(path.name), suffix=SUFFIX, dir=inside))
        try:
            with _named_as_asked(staging, path):
                yield staging
            if path.exists():
                _move_into(path, staging)
            else:
                Place(path).keep_rights(staging, 0o777)
                staging.replace(path)
        finally:
            shutil.rmtree(staging, ignore_errors=True)


@contextlib.contextmanager
def _named_as_asked(staging: Path, path: Path) -> Iterator[None]:
    """Name a file of a staging folder in messages by the place that was asked for."""
    try:
        yield
    except OutputError as fault:
        if fault.where is None or not fault.where.startswith(f"{staging}{os.sep}"):
            raise
        place = f"{path}{fault.where[len(str(staging)) :]}"
        raise OutputError(fault.what, where=place, value=fault.value, limit=fault.limit, hint=fault.hint) from fault


def _second_name(file: Path, link: Path) -> None:
    """Keep a file under a second name; a copy where the file system has no links."""
    link.unlink()
    try:
        link.hardlink_to(file)
    except OSError:
        shutil.copy2(file, link)


def _move_into(path: Path, staging: Path) -> None:
    """Move every file of a staging folder to its place; on any exception everything is put back as it was.

    What is written into a device or a pipe cannot be taken back: it comes last.
    """
    files = [item.relative_to(staging) for item in sorted(staging.rglob("*")) if item.is_file()]
    done: list[tuple[Path, Path | None]] = []
    poured: list[tuple[Place, Path]] = []
    with contextlib.ExitStack() as parents:
        try:
            for name in files:
                destination = path / name
                parents.enter_context(_parents_of(destination))
                if destination.is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} is a folder there")
                place = place_of(destination)
                if place.through:
                    poured.append((place, staging / name))
                    continue
                made, elsewhere = staging / name, destination.is_symlink()
                if elsewhere:  # perhaps in another file system
                    parents.enter_context(_parents_of(place.path))
                    made = _part_of(place)
                    parents.callback(made.unlink, missing_ok=True)
                    shutil.copyfile(staging / name, made)
                before = None
                if place.before is not None:
                    before = _part_of(place)
                    parents.callback(before.unlink, missing_ok=True)
                    _second_name(place.path, before)
                if elsewhere or before is not None:
                    place.keep_rights(made, 0o666)
                done.append((place.path, before))
                made.replace(place.path)
            for place, made in poured:
                place.pour(made)
        except BaseException:
            for destination, before in reversed(done):
                if before is None:
                    destination.unlink(missing_ok=True)
                else:
                    before.replace(destination)
            raise
