"""Whether the file that a run log is written to is still where it was begun, so that somebody will find it."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

GONE: Final = -1
"""In place of the number of a system's error."""
_SAID: Final = "its folder or file was removed, moved or replaced"
LOOKED_S: Final = 0.5
"""How often it is looked for."""


class LogGone(OSError):
    """The file of the log is not where it was begun."""

    def __init__(self) -> None:
        super().__init__(GONE, _SAID)


class LogPlace:
    """The file of a log, and the folder it was begun in.

    Args:
        path: Of the file.
        handle: Of the open file.
    """

    def __init__(self, path: Path, handle: int) -> None:
        self._path, self._file = path, os.fstat(handle)
        self._folder = path.parent.stat()
        self._handle = handle

    def check(self) -> None:
        """Look whether file and folder are those that were begun.

        Raises:
            LogGone: The file has no name any more, its folder was removed or replaced, its path leads to another file
                or to another device.
        """
        try:
            file, folder = self._path.stat(), self._path.parent.stat()
        except OSError as fault:
            if fault.errno in (errno.ENOENT, errno.ENOTDIR, errno.ESTALE):
                raise LogGone from fault
            raise
        same = os.path.samestat(file, self._file) and os.path.samestat(folder, self._folder)
        if not same or os.fstat(self._handle).st_nlink == 0:
            raise LogGone


def trouble_said(number: int) -> str:
    """What the number of a trouble means: of the system's error, or :data:`GONE`; empty for 0."""
    if number == 0:
        return ""
    return _SAID if number == GONE else os.strerror(number)
