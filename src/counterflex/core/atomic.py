"""Write results whole or not at all: to a temporary file beside the target, then rename; devices are written into.

File and folder are put on the disk before and after the rename: a power failure leaves the former or the new content.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

from counterflex.core.errors import CounterflexError, OutputError
from counterflex.core.moving import NEW, move_into, parents_of, settle, sync_file, sync_folder, sync_tree
from counterflex.core.output_place import (
    SUFFIX,
    OutputPlace,
    clear_leftovers,
    is_staged,
    part_file,
    part_prefix,
    place_of,
)
from counterflex.core.system_fault import FULL, system_fault

_OTHER = "Choose another place"


@contextlib.contextmanager
def _refused_in_one_line(path: Path) -> Iterator[None]:
    """Raise what the system or a library says of a target that takes no data as one :class:`OutputError`."""
    try:
        yield
    except (CounterflexError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except UnicodeEncodeError as fault:
        raise OutputError(
            "cannot write: a name in the text is not UTF-8",
            where=str(path),
            value=ascii(fault.object[max(fault.start - 20, 0) : fault.end + 20]),
            hint="Rename the file or folder that the name comes from",
        ) from fault
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
        settle(place.path)
        with parents_of(place.path):
            part = part_file(place)
            try:
                yield part
                place.keep_rights(part, 0o666)
                staged = is_staged(place.path)  # then it is put on the disk with the folder
                if not staged:
                    sync_file(part)
                    settle(place.path)
                part.replace(place.path)
                if not staged:
                    sync_folder(place.path.parent)
            finally:
                part.unlink(missing_ok=True)


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
    """Yield a staging folder; when the block ends well, move all of its files into ``target`` together.

    Files already in ``target`` under the same names are replaced, others are left alone. A command that is killed
    while they are moved leaves no former file beside a new one; the next that reads or writes the folder completes it
    (:mod:`counterflex.core.moving`). On any exception nothing in ``target`` changes, and a folder that was not there is
    not made. That ``target`` can be written is found out before the block begins, so that no long job is done in vain.
    Links and devices in ``target`` are treated as :func:`atomic_path` treats them.

    Raises:
        OutputError: The folder cannot be made or written.
    """
    path = Path(target)
    if path.exists() and not path.is_dir():
        raise OutputError("cannot write: a file has the name of the folder", where=str(path), hint=_OTHER)
    if path.is_symlink():
        path = Path(os.path.realpath(path))
    settle(path)
    with _refused_in_one_line(path), parents_of(path):
        inside = path if path.exists() else path.parent
        for folder in {inside, path.parent}:
            clear_leftovers(folder, path.name)
        staging = Path(tempfile.mkdtemp(prefix=part_prefix(path.name), suffix=SUFFIX, dir=inside))
        try:
            (staging / NEW).mkdir()
            with _named_as_asked(staging / NEW, path):
                yield staging / NEW
            if path.exists():
                move_into(path, staging)
            else:
                OutputPlace(path).keep_rights(staging / NEW, 0o777)
                if not is_staged(path):
                    sync_tree(staging / NEW)
                (staging / NEW).replace(path)
                sync_folder(path.parent)
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
