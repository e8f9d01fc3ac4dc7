"""Folder of this user for compiled kernels, locks and the verdict on the computer.

Compiled kernels are serialized objects that are executed when they are read, and a lock says where a run is found. Both
are therefore read only from a folder that nobody else can write into.
"""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import Final

from counterflex.core.errors import OutputError

VARIABLE: Final = "COUNTERFLEX_CACHE"
_OTHERS_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH


class SharedFolderError(OutputError):
    """The folder is another user's, or another user can write into it."""


def user_folder() -> Path:
    """Return the path of the folder, which need not exist: ``COUNTERFLEX_CACHE``, else below the user's cache folder.

    Raises:
        OutputError: The user has no home folder.
    """
    if given := os.environ.get(VARIABLE):
        return Path(given).absolute()
    base = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME", "")
    if Path(base).is_absolute():
        return Path(base) / "counterflex"
    try:
        return Path.home() / ".cache" / "counterflex"
    except RuntimeError as fault:
        raise OutputError("this user has no home folder", hint=f"Name a folder of your own in {VARIABLE}") from fault


def made_own(folder: Path) -> Path:
    """Make a folder of mode 0700 where there is none, and return it.

    A folder of this user that others can read is closed to them; so is an empty one that they could write into.

    Raises:
        OSError: It cannot be made.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        _close(folder)
    require_own(folder)
    return folder


def _close(folder: Path) -> None:
    """Take the rights of others away where the content of the folder is certainly this user's."""
    status = folder.lstat()
    if os.name != "posix" or not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid():
        return
    if status.st_mode & _OTHERS_WRITE and any(folder.iterdir()):
        return
    if stat.S_IMODE(status.st_mode) & 0o077:
        folder.chmod(0o700)
        if status.st_mode & _OTHERS_WRITE and any(folder.iterdir()):  # written between the look and the closing
            folder.chmod(stat.S_IMODE(status.st_mode))


def require_own(folder: Path) -> None:
    """Refuse a folder that another user owns, can write into, or can exchange.

    Windows keeps the cache folder of a user closed by itself; nothing is tested there.

    Args:
        folder: Must exist.

    Raises:
        SharedFolderError: It is a link or no folder, of another owner, or writable by others.
        OSError: It cannot be examined.
    """
    if os.name != "posix":
        return
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode):
        what = "a link" if stat.S_ISLNK(status.st_mode) else "no folder"
        raise _refused(folder, f"the folder for compiled kernels and locks is {what}")
    if status.st_uid != os.geteuid():
        raise _refused(
            folder,
            "the folder for compiled kernels and locks belongs to another user",
            f"user {status.st_uid}",
            f"user {os.geteuid()}",
        )
    if status.st_mode & _OTHERS_WRITE:
        raise _refused(
            folder,
            "other users can write into the folder for compiled kernels and locks",
            f"mode {stat.S_IMODE(status.st_mode):04o}",
            "mode 0700",
        )
    for above in Path(os.path.realpath(folder)).parents:
        mode = above.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise _refused(
                above,
                "every user can exchange the folder for compiled kernels and locks that lies below this one",
                f"mode {stat.S_IMODE(mode):04o}",
            )


def _refused(place: Path, what: str, value: str | None = None, limit: str | None = None) -> SharedFolderError:
    return SharedFolderError(
        what,
        where=str(place),
        value=value,
        limit=limit,
        hint=f"Remove that folder if it is yours, or name another folder of your own in {VARIABLE}",
    )
