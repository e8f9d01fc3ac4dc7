"""Check that the files that a run log was and is written to are still where they were begun, so that they are found."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

GONE: Final = -1
"""In place of the number of a system's error."""
_REMOVED_TEXT: Final = "its folder or file was removed, moved or replaced"
LOOKED_S: Final = 0.5
"""How often it is looked for."""
_NOT_THERE: Final = (errno.ENOENT, errno.ENOTDIR, errno.ESTALE)


class LogGone(OSError):
    """The file of the log is not where it was begun."""

    def __init__(self) -> None:
        super().__init__(GONE, _REMOVED_TEXT)


class LogPlace:
    """The file of a log, and the folder it was begun in."""

    def __init__(self, path: Path, handle: int) -> None:
        self.path, self._file = path, os.fstat(handle)
        self._folder = path.parent.stat()
        self._handle = handle

    def check(self) -> None:
        """Look whether file and folder are those that were begun.

        Raises:
            LogGone: The file has no name any more, its folder was removed or replaced, its path leads to another file
                or to another device.
        """
        try:
            file, folder = self.path.stat(), self.path.parent.stat()
        except OSError as fault:
            if fault.errno in _NOT_THERE:
                raise LogGone from fault
            raise
        same = os.path.samestat(file, self._file) and os.path.samestat(folder, self._folder)
        if not same or os.fstat(self._handle).st_nlink == 0:
            raise LogGone


class LogBefore:
    """The files of a log that are not written to any more."""

    def __init__(self) -> None:
        self._files: list[tuple[Path, int]] = []

    def add(self, path: Path, records: int) -> None:
        """Take a closed file with the number of records that were written to it."""
        if records:
            self._files.append((path, records))

    def gone(self) -> int:
        """Records of the files that are no longer where they were written; each file is told once.

        A file of which the system cannot say at the moment whether it is there is taken to be there.
        """
        there = [one for one in self._files if _may_be_there(one[0])]
        lost = sum(records for _, records in self._files) - sum(records for _, records in there)
        self._files = there
        return lost


def _may_be_there(path: Path) -> bool:
    try:
        path.stat()
    except OSError as fault:
        return fault.errno not in _NOT_THERE
    return True


def trouble_message(number: int) -> str:
    """Return what the number of a trouble means: of the system's error, or :data:`GONE`; empty for 0."""
    if number == 0:
        return ""
    return _REMOVED_TEXT if number == GONE else os.strerror(number)
