"""Files that are held: the kernel says whether a process that uses them still lives, and frees them when it dies.

A lock belongs to the open file and not to the number of a process, so that a number that is given to another process
later deceives nobody, and processes of another container count as well. On Windows an open file cannot be removed,
which says the same.

Files that are read, changed and written again: one process at a time.

A file that is replaced by a rename cannot be locked itself: the next one would lock the file that was replaced. Its
folder is locked instead; where folders cannot be opened (Windows), a file beside it that is removed afterwards.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from counterflex.core.errors import OutputError

PATIENCE_S: Final = 20.0
"""Longest time to wait for another process; an edit takes some 0.1 s."""
_POLL_S: Final = 0.01
_mine = threading.local()


@contextlib.contextmanager
def alone(
    target: str | os.PathLike[str],
    *,
    clock_s: Callable[[], float] = time.monotonic,
    wait: Callable[[float], None] = time.sleep,
) -> Iterator[None]:
    """Let no other process edit a file, or any beside it, while the block reads, changes and replaces it.

    Blocks of one thread may lie in each other. Where the file system has no locks the block runs without one.

    Args:
        target: File that is edited; it need not be there, nor the folder that it lies in.

    Raises:
        OutputError: Another process holds it for longer than :data:`PATIENCE_S`.
    """
    path = Path(os.path.realpath(target))
    folder = next(one for one in path.parents if one.is_dir())
    held_by_me: set[Path] = _mine.__dict__.setdefault("folders", set())
    if folder in held_by_me:
        yield
        return
    with _opened(folder / path.name) as handle:
        end = clock_s() + PATIENCE_S
        while handle is not None and own(handle) is False:
            if clock_s() > end:
                raise OutputError(
                    "another process edits a file in this folder",
                    where=str(folder),
                    value=f"waited {PATIENCE_S:.0f} s",
                    hint="End the other counterflex, and try again",
                )
            wait(_POLL_S)
        held_by_me.add(folder)
        try:
            yield
        finally:
            held_by_me.discard(folder)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int | None]:
    """Open what stands for the file; None where it cannot be opened, as a folder that may be written but not read."""
    place = path.with_name(f".{path.name}.lock") if sys.platform == "win32" else path.parent
    flags = os.O_RDWR | os.O_CREAT if sys.platform == "win32" else os.O_RDONLY
    try:
        handle = os.open(place, flags)
    except OSError:
        yield None
        return
    try:
        yield handle
    finally:
        os.close(handle)
        if sys.platform == "win32":
            with contextlib.suppress(OSError):
                place.unlink()


if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

_BOOT: Final = Path("/proc/sys/kernel/random/boot_id")
_LOCKED_AT: Final = 1 << 30  # Byte that is locked on Windows: beyond all content, so that others may read it
_HELD: Final = (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK)


def own(handle: int) -> bool | None:
    """Hold an open file alone, as long as it is open.

    Returns:
        True: it is held; False: another holds it; None: the file system has no locks, so that nothing is known.
    """
    try:
        if sys.platform == "win32":
            before = os.lseek(handle, 0, os.SEEK_CUR)
            os.lseek(handle, _LOCKED_AT, os.SEEK_SET)
            try:
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            finally:
                os.lseek(handle, before, os.SEEK_SET)
        else:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as fault:
        return False if fault.errno in _HELD else None
    return True


def share(handle: int) -> bool:
    """Hold an open file together with others, as long as it, or memory that is mapped from it, is open.

    Returns:
        Whether the file still has a name: it may have been cleared before it was held.
    """
    if sys.platform == "win32":
        return True
    with contextlib.suppress(OSError):
        fcntl.flock(handle, fcntl.LOCK_SH)
    return os.fstat(handle).st_nlink > 0


def clear_unheld(folder: Path, prefix: str) -> None:
    """Remove files of this user that nobody holds: all processes that shared them have died.

    Nothing is said, and nothing fails: what cannot be removed stays, and all stays where there are no locks.

    Args:
        prefix: Of their names; such files are held by :func:`share` by everybody who uses them.
    """
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            if entry.name.startswith(prefix) and entry.is_file(follow_symlinks=False):
                with contextlib.suppress(OSError):
                    _clear(Path(entry.path))


def _clear(path: Path) -> None:
    if sys.platform == "win32":
        path.unlink()  # refused while it is open
        return
    handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
    try:
        if os.fstat(handle).st_uid == os.getuid() and own(handle):
            path.unlink()
    finally:
        os.close(handle)


def boot_id() -> str:
    """Return what the kernel calls this start of the machine; empty where it does not say."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""
