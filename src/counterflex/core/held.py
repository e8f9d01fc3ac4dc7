"""Files that are held: the kernel says whether a process that uses them still lives, and frees them when it dies.

A lock belongs to the open file and not to the number of a process, so that a number that is given to another process
later deceives nobody, and processes of another container count as well. On Windows an open file cannot be removed,
which says the same.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from pathlib import Path
from typing import Final

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

_BOOT: Final = Path("/proc/sys/kernel/random/boot_id")
_LOCKED_AT: Final = 1 << 30
"""Byte that is locked on Windows: beyond all content, so that others may read it."""
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
        folder: Where they lie.
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
    """What the kernel calls this start of the machine; empty where it does not say."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""
