"""Real place of an output: the file behind all links, or a device, pipe or open descriptor.

Temporary files beside it carry the process that made them in their names: what a killed process left is cleared by the
next one.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO

SUFFIX: Final = ".part"
_LONGEST_NAME: Final = 160
"""Bytes of a name; file systems take 255, and a temporary file has up to 52 more than its output."""
_HOST: Final = re.sub(r"[^A-Za-z0-9]", "", platform.node())[:24] or "here"


def part_prefix(name: str) -> str:
    """Beginning of the name of a temporary file or folder for an output: ``.NAME.HOST-PID-``."""
    return f".{_short(name)}.{_HOST}-{os.getpid()}-"


def _short(name: str) -> str:
    """Return a name, or its hash where it leaves no room for what a temporary file has in addition."""
    data = os.fsencode(name)
    return name if len(data) <= _LONGEST_NAME else hashlib.sha256(data).hexdigest()[:32]


def clear_leftovers(folder: Path, name: str) -> None:
    """Remove temporary files and folders for an output whose process is gone: it was killed, or the computer stopped.

    Only what this program named for this output on this computer is touched, and never what belongs to a process that
    lives. Nothing is said, and nothing fails: what cannot be removed stays.
    """
    if os.name != "posix":  # elsewhere there is no harmless way to ask for a process
        return
    mine = re.compile(rf"\.{re.escape(_short(name))}\.{re.escape(_HOST)}-(\d+)-\w+{re.escape(SUFFIX)}")
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(folder)):
            match = mine.fullmatch(entry.name)
            if match is None or process_lives(int(match[1])):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                with contextlib.suppress(OSError):
                    Path(entry.path).unlink()


def process_lives(process: int) -> bool:
    """Return whether a process of this computer lives; one that only waits to be buried does not.

    Where the system has no harmless way to ask (other than POSIX) every process lives.
    """
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    try:
        stat_line = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return True
    return stat_line.rpartition(")")[2].strip()[:1] not in ("Z", "X")


_DESCRIPTOR: Final = re.compile(r"(?:/proc/(?P<process>\d+)|/dev)/fd/(?P<number>\d+)")
_MOST_LINKS: Final = 40


@dataclass(frozen=True)
class OutputPlace:
    """Real place of an output."""

    path: Path  # The file itself, behind all symbolic links; need not be there
    # Something that is not a regular file (device, pipe, socket, open descriptor): it is written into and never
    # replaced
    through: bool = False
    # Of this process, where ``path`` names one (``/dev/stdout``, ``/dev/fd/3``); else None
    descriptor: int | None = None
    before: os.stat_result | None = None  # State of the regular file that is there already; None where there is none

    def keep_rights(self, made: Path, mode: int) -> None:
        """Give a file that takes this place the mode and owner of the one before, else the usual rights.

        Args:
            mode: Rights of a file made in the usual way, before the umask.
        """
        if self.before is None:
            umask = os.umask(0)
            os.umask(umask)
            made.chmod(mode & ~umask)
            return
        if hasattr(os, "chown"):
            with contextlib.suppress(OSError):  # only root may give files away
                os.chown(made, self.before.st_uid, self.before.st_gid)
        made.chmod(stat.S_IMODE(self.before.st_mode))

    def pour(self, made: Path) -> None:
        """Write a finished file into what cannot be replaced.

        Raises:
            OSError: It does not take it (full, closed by the reader, no permission).
        """
        with made.open("rb") as source, os.fdopen(self._descriptor(), "wb") as sink:
            shutil.copyfileobj(source, sink)

    def opened(self, encoding: str) -> TextIO:
        """A stream of text that begins anew here, line ends as written. Raises OSError: it cannot be opened."""
        return os.fdopen(self._descriptor(), "w", encoding=encoding, newline="")

    def _descriptor(self) -> int:
        if self.descriptor is not None:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            return os.dup(self.descriptor)  # shares its position: what is printed afterwards follows
        flags = os.O_WRONLY | os.O_TRUNC | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
        return os.open(self.path, flags if self.through else flags | os.O_CREAT, 0o666)


def place_of(target: str | os.PathLike[str]) -> OutputPlace:
    """Find where an output really goes.

    Raises:
        OSError: The name leads in circles, is a folder, or the file there may not be written.
    """
    path = Path(target)
    for _ in range(_MOST_LINKS):
        path = Path(os.path.realpath(path.parent)) / path.name
        known = _DESCRIPTOR.fullmatch(path.as_posix())
        if known and known["process"] in (None, str(os.getpid())):
            return OutputPlace(path, through=True, descriptor=int(known["number"]))
        if path.parent.as_posix().startswith("/proc/") or not path.is_symlink():
            break
        path = path.parent / path.readlink()
    else:
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    try:
        status = path.stat()
    except FileNotFoundError:
        return OutputPlace(path)
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, "a folder has this name")
    if not os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    regular = stat.S_ISREG(status.st_mode) and not path.parent.as_posix().startswith("/proc/")
    return OutputPlace(path, through=not regular, before=status if regular else None)


def part_file(place: OutputPlace) -> Path:
    """Make an empty temporary file beside the place that it is made for."""
    clear_leftovers(place.path.parent, place.path.name)
    handle, name = tempfile.mkstemp(prefix=part_prefix(place.path.name), suffix=SUFFIX, dir=place.path.parent)
    os.close(handle)
    return Path(name)


def is_staged(path: Path) -> bool:
    """Return whether a path is in a temporary folder of this process, which is moved to its place as a whole."""
    mine = f".{_HOST}-{os.getpid()}-"
    return any(mine in part and part.endswith(SUFFIX) for part in path.parts)


def is_printed(target: str | os.PathLike[str]) -> bool:
    """Return whether an output goes where this program prints: then nothing else should be printed there."""
    try:
        place = place_of(target)
        status = place.path.stat() if place.descriptor is None else os.fstat(place.descriptor)
        printed = os.fstat(sys.stdout.fileno())
    except (OSError, ValueError):
        return False
    return place.through and os.path.samestat(status, printed)
