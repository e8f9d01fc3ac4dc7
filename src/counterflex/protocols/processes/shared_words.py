"""Whole numbers of 64 bits in memory that several processes share, also such that were not started by one another.

The memory is a file of its user only (mode 0600), on Linux one that never touches a disk. Who can open it can read and
write it, nobody else. Needs no more than Python itself: a command that must be quick joins it in a millisecond.
Who shares the numbers holds the file (:mod:`counterflex.core.held`); what nobody holds was left by processes that were
killed, and is cleared when the next ones are made.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import mmap
import os
import stat
import tempfile
from pathlib import Path
from typing import Final, Self

from counterflex.core.errors import InputError, OutputError
from counterflex.core.held import clear_unheld, share

_SHARED: Final = Path("/dev/shm")
_PREFIX: Final = "counterflex-words-"
_BYTES: Final = 8
_LONGEST: Final = 4096
"""Longest text that says where shared numbers are."""


class SharedWords:
    """Shared whole numbers, all 0 at first.

    Args:
        count: How many.
        path: None makes them; the path of existing ones joins them.
        make: Make them at that path.

    Attributes:
        path: Of the file, to join it.
        words: (count,) view; each is written and read whole.

    Raises:
        InputError: There are none of that path, they are not as many, or they are another user's.
        OutputError: There is no room for them.
    """

    def __init__(self, count: int, path: Path | None = None, *, make: bool = False) -> None:
        if path is None:
            handle, self.path = _made(count * _BYTES)
        elif make:
            handle, self.path = made_at(path, count * _BYTES), path
        else:
            handle, self.path = _opened(path, count * _BYTES), path
        try:
            self._memory = mmap.mmap(handle, count * _BYTES)  # has a handle of its own: holds the file as long as it is
        finally:
            os.close(handle)
        self.words = memoryview(self._memory).cast("q")

    def __enter__(self) -> Self:
        """The words."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave them."""
        self.close()

    def close(self) -> None:
        """Leave them; who still looks at them goes on seeing them."""
        with contextlib.suppress(BufferError):
            self.words.release()
            self._memory.close()

    def remove(self) -> None:
        """Nobody can join them any more."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)


def kept_at(lock: Path) -> Path:
    """Return where numbers are shared that outlive all processes of a run: one place for each lock file."""
    folder = _SHARED if _SHARED.is_dir() and os.access(_SHARED, os.W_OK) else Path(tempfile.gettempdir())
    return folder / f"counterflex-kept-{hashlib.sha256(os.fsencode(lock.absolute())).hexdigest()[:16]}"


def _made(size: int) -> tuple[int, Path]:
    folder = _SHARED if _SHARED.is_dir() and os.access(_SHARED, os.W_OK) else None
    clear_unheld(folder or Path(tempfile.gettempdir()), _PREFIX)
    try:
        handle, name = _new(folder)
        try:
            os.write(handle, bytes(size))  # takes the room now: a hole that cannot be filled later ends a process
        except OSError:
            os.close(handle)
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as fault:
        raise OutputError(
            f"no shared memory: {fault.strerror or fault}", where=str(folder or "temporary files")
        ) from fault
    return handle, Path(name)


def made_at(path: Path, size: int) -> int:
    """Handle of a new file of this user, held, of zeros.

    Args:
        path: Of the file, which must not be there.

    Raises:
        OutputError: It is there, or there is no room.
    """
    try:
        while True:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
            if share(handle):
                break
            os.close(handle)  # cleared between its making and its holding
        try:
            os.write(handle, bytes(size))
        except OSError:
            os.close(handle)
            path.unlink(missing_ok=True)
            raise
    except OSError as fault:
        raise OutputError(f"no shared memory: {fault.strerror or fault}", where=str(path)) from fault
    return handle


def _new(folder: Path | None) -> tuple[int, str]:
    """An empty file that is held; another process may clear one between its making and its holding."""
    while True:
        handle, name = tempfile.mkstemp(prefix=_PREFIX, dir=folder)  # mode 0600
        if share(handle):
            return handle, name
        os.close(handle)


def _opened(path: Path, size: int) -> int:
    try:
        handle = os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    except OSError as fault:
        raise InputError(f"no shared memory there: {fault.strerror or fault}", where=str(path)) from fault
    status = os.fstat(handle)
    if status.st_size != size or not _is_private(status):
        os.close(handle)
        raise InputError("not the shared memory of a run of yours", where=str(path), value=status.st_size, limit=size)
    if not share(handle):  # after the owner is known: another user's lock would be waited for
        os.close(handle)
        raise InputError("no shared memory there: it has just been cleared", where=str(path))
    return handle


def _is_private(status: os.stat_result) -> bool:
    """Return whether a file is as this program makes shared memory: of this user alone, under one name."""
    if os.name != "posix":
        return True
    alone = stat.S_ISREG(status.st_mode) and status.st_nlink == 1 and not status.st_mode & 0o077
    return alone and status.st_uid == os.getuid()


def words_of(file: Path) -> tuple[Path, int]:
    """Read from a file in the folder of a run where its shared numbers are, and its process.

    The folder may be another user's, or come from elsewhere: what the file names is shared memory of this program or
    nothing, so that no request is written into another file.

    Raises:
        OSError: It cannot be read, or is a link or no regular file.
        ValueError: It does not say that, or names another file.
    """
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with os.fdopen(os.open(file, flags), "rb") as stream:
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise ValueError("no regular file")
        try:
            content = json.loads(stream.read(_LONGEST))
            words, process = Path(content["words"]), int(content["pid"])
        except (KeyError, TypeError, RecursionError) as fault:
            raise ValueError("no words") from fault
    if not words.name.startswith(_PREFIX):  # its folder is that of the other process's temporary files
        raise ValueError("names another file")
    return words, process
