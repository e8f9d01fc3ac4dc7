"""Replace several files of a folder together, through a journal that the next command completes after a kill.

    staging/new                  the job writes here; a failure leaves the folder as it was
    folder/.counterflex-moving   the staging folder after its rename: from here on the new files count
        lock                     held by the process that moves
        new/                     files that are not in place yet
        old/                     former files, taken away before the first new one is placed

Old and new files therefore never stand beside each other, whenever the process is killed. Everything is on the disk
before the rename, so that the same holds for a power failure.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from counterflex.core.errors import CounterflexError, FileFormatError
from counterflex.core.held import own
from counterflex.core.output_place import (
    SUFFIX,
    OutputPlace,
    is_staged,
    part_file,
    part_prefix,
    place_of,
    process_lives,
)

JOURNAL: Final = ".counterflex-moving"
NEW: Final = "new"
_OLD: Final = "old"
_POURED: Final = "poured"
"""Of files for pipes and devices: what was written there cannot be written again, so that a later command leaves it."""
_LOCK: Final = "lock"
_WAIT_S: Final = 10.0
"""Longest wait for a process that moves files; it takes milliseconds, and seconds on a slow network disk."""
_LOOK_S: Final = 0.01
_TRIES: Final = 20  # Other commands that may be faster, one after the other


def sync_file(path: Path) -> None:
    """Put the content of a file on the disk. Raises OSError: the disk failed."""
    handle = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(path: Path) -> None:
    """Put the names in a folder on the disk, where the system can do that for a folder."""
    with contextlib.suppress(OSError):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def sync_tree(folder: Path) -> None:
    """Put a folder with all that is in it on the disk. Raises OSError: the disk failed."""
    for place, _, names in os.walk(folder, topdown=False):
        for name in names:
            if (path := Path(place) / name).is_file() and not path.is_symlink():
                sync_file(path)
        sync_folder(Path(place))


@contextlib.contextmanager
def parents_of(path: Path) -> Iterator[None]:
    """Make the folders above a path; on any exception those that were not there before are removed again."""
    made: list[Path] = []
    try:
        for folder in reversed(path.parents):
            if not folder.exists():
                folder.mkdir(exist_ok=True)
                made.append(folder)
                if not is_staged(folder):
                    sync_folder(folder.parent)
        yield
    except BaseException:
        for folder in reversed(made):
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


@dataclass(frozen=True)
class _Move:
    """A file on its way: where it is made, where it goes, where the former one is kept."""

    made: Path
    place: OutputPlace
    kept: Path
    linked: bool

    def take_away(self) -> None:
        if self.linked:  # perhaps in another file system; the copy takes its place in one step
            shutil.copyfile(self.place.path, self.kept)
        else:
            self.place.path.replace(self.kept)

    def put(self) -> None:
        if self.linked:
            _copied_to(self.made, self.place)
        else:
            self.made.replace(self.place.path)

    def put_back(self) -> None:
        """Take the new file back, where it is there."""
        if not self.linked and not self.made.exists():
            self.place.path.replace(self.made)
        elif self.linked and self.place.before is None:
            self.place.path.unlink(missing_ok=True)

    def restore(self) -> None:
        """Place the former file again, where there was one."""
        if not self.kept.exists():
            return
        if self.linked:
            _copied_to(self.kept, self.place)
        else:
            self.kept.replace(self.place.path)


def _copied_to(made: Path, place: OutputPlace) -> None:
    part = part_file(place)
    try:
        shutil.copyfile(made, part)
        place.keep_rights(part, 0o666)
        sync_file(part)
        part.replace(place.path)
        sync_folder(place.path.parent)
    finally:
        part.unlink(missing_ok=True)


def move_into(folder: Path, staging: Path) -> None:
    """Move every file of a staging folder to its place; on any exception everything is put back as it was.

    What is written into a device or a pipe cannot be taken back: it comes last.

    Args:
        folder: Must exist.
        staging: Has its files in :data:`NEW`; it is in the same file system.

    Raises:
        FileFormatError: Another command has not ended moving files there, see :func:`settle`.
        OSError: A file cannot be placed.
    """
    names = [item.relative_to(staging / NEW) for item in sorted((staging / NEW).rglob("*")) if item.is_file()]
    poured: list[tuple[OutputPlace, Path]] = []
    moves: list[_Move] = []
    with contextlib.ExitStack() as parents:
        for name in names:
            destination, made = folder / name, staging / NEW / name
            parents.enter_context(parents_of(destination))
            if destination.is_dir():
                raise IsADirectoryError(errno.EISDIR, f"{name} is a folder there")
            place, linked = place_of(destination), destination.is_symlink()
            if place.through:
                aside = staging / _POURED / name
                aside.parent.mkdir(parents=True, exist_ok=True)
                made.replace(aside)
                poured.append((place, folder / JOURNAL / _POURED / name))
                continue
            if linked:
                parents.enter_context(parents_of(place.path))
            elif place.before is not None:
                place.keep_rights(made, 0o666)
            moves.append(_Move(folder / JOURNAL / NEW / name, place, folder / JOURNAL / _OLD / name, linked))
        if not is_staged(folder):
            sync_tree(staging / NEW)
        if len(moves) == 1 and not poured and not moves[0].linked:  # one step needs no journal
            (staging / NEW / names[0]).replace(moves[0].place.path)
            sync_folder(moves[0].place.path.parent)
            return
        with _begun(folder, staging):
            _carry_out(moves, poured, lambda: _retire(folder / JOURNAL, staging))


def _retire(journal: Path, staging: Path) -> None:
    """Take the name of the journal away in one step; where that fails, the next command finds nothing to move."""
    with contextlib.suppress(OSError):
        journal.replace(staging)


def _carry_out(moves: list[_Move], poured: list[tuple[OutputPlace, Path]], retire: Callable[[], None]) -> None:
    """Take all former files away, place all new ones, then fill pipes; or leave everything as it was."""
    try:
        for move in moves:
            if move.place.before is not None:
                move.kept.parent.mkdir(parents=True, exist_ok=True)
                move.take_away()
        for move in moves:
            move.put()
        for place, made in poured:
            place.pour(made)
    except BaseException:
        for move in reversed(moves):
            move.put_back()
        for move in reversed(moves):
            move.restore()
        retire()  # not reached where a file could not be put back: the next command then completes what is new
        raise
    for parent in {move.place.path.parent for move in moves}:
        sync_folder(parent)
    retire()


@contextlib.contextmanager
def _begun(folder: Path, staging: Path) -> Iterator[None]:
    """Give the staging folder the name of the journal, and hold it."""
    (staging / _LOCK).write_text(str(os.getpid()), encoding="ascii")
    sync_file(staging / _LOCK)
    sync_folder(staging)
    with contextlib.ExitStack() as stack:
        if os.name == "posix":  # elsewhere a folder with an open file cannot be renamed
            stack.callback(os.close, _held(staging))
        for _ in range(_TRIES):
            settle(folder)
            try:
                staging.replace(folder / JOURNAL)
                break
            except OSError as fault:
                if fault.errno not in (errno.ENOTEMPTY, errno.EEXIST):  # else another command was faster
                    raise
        else:
            raise _refusal(folder, "another command is writing into this folder")
        sync_folder(folder)
        yield


def _held(journal: Path) -> int:
    handle = os.open(journal / _LOCK, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    own(handle)
    return handle


def settle(path: str | os.PathLike[str]) -> None:
    """Complete what a killed command had begun to move into a folder or into one above it; wait for a living one.

    Args:
        path: Of a file or folder that is about to be read or written; need not exist.

    Raises:
        FileFormatError: It cannot be completed: it belongs to another user, the folder cannot be written, another
            command does not end, or the journal is none of this program.
    """
    place = Path(path).absolute()
    for folder in (place, *place.parents):
        if _is_there(folder / JOURNAL):
            _settle(folder)


def _is_there(path: Path) -> bool:
    try:
        path.lstat()
    except (OSError, ValueError):  # too long a name, a zero byte: whoever reads it says so
        return False
    return True


def _settle(folder: Path) -> None:
    journal = folder / JOURNAL
    try:
        status = journal.lstat()
        if os.name == "posix" and status.st_uid != os.geteuid():
            if folder.stat().st_mode & stat.S_ISVTX:  # a folder for temporary files of everybody
                return
            raise _refusal(folder, _KILLED, f"user {status.st_uid} wrote")
        if not stat.S_ISDIR(status.st_mode):
            raise _refusal(folder, f"{JOURNAL} there is no folder of counterflex")
        handle = os.open(journal / _LOCK, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
    except FileNotFoundError:
        if _is_there(journal) and not _is_there(journal / _LOCK):
            raise _refusal(folder, f"{JOURNAL} there is no folder of counterflex") from None
        return
    except OSError as fault:
        if isinstance(fault, CounterflexError):
            raise
        raise _refusal(folder, _KILLED, fault.strerror) from fault
    try:
        _wait(handle, folder)
        with contextlib.suppress(FileNotFoundError):  # ended while this one waited
            if os.path.samestat(os.fstat(handle), (journal / _LOCK).stat()):
                _complete(folder, journal)
    except OSError as fault:
        if isinstance(fault, CounterflexError):
            raise
        raise _refusal(folder, _KILLED, fault.strerror) from fault
    finally:
        os.close(handle)


def _wait(handle: int, folder: Path) -> None:
    """Hold a journal as soon as its process has ended."""
    end = time.monotonic() + _WAIT_S
    while not (held := own(handle)):
        if held is None and not process_lives(int(os.pread(handle, 20, 0) or b"0")):
            return
        if time.monotonic() > end:
            raise _refusal(folder, "another command is writing into this folder")
        time.sleep(_LOOK_S)


def _complete(folder: Path, journal: Path) -> None:
    """Move what a killed command had not yet moved; never through a link: a journal may come out of an archive."""
    names = [item.relative_to(journal / NEW) for item in sorted((journal / NEW).rglob("*")) if not item.is_dir()]
    for name in names:
        way = [folder / name, *(folder / part for part in name.parents if part != Path())]
        if any(one.is_symlink() for one in (*way, journal / NEW / name)) or (folder / name).is_dir():
            raise _refusal(folder, _KILLED, f"{name} leads elsewhere")
    for name in names:
        if (folder / name).exists():
            (journal / _OLD / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).replace(journal / _OLD / name)
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (journal / NEW / name).replace(folder / name)
    for parent in {(folder / name).parent for name in names}:
        sync_folder(parent)
    done = folder / f"{part_prefix(folder.name)}done{SUFFIX}"
    journal.replace(done)
    shutil.rmtree(done, ignore_errors=True)


_KILLED: Final = "a command was killed while it wrote this folder, and it cannot be completed"


def _refusal(folder: Path, what: str, value: str | None = None) -> FileFormatError:
    return FileFormatError(
        what,
        where=str(folder),
        value=value,
        hint=f"If no command is running there, remove {JOURNAL} in it and write the folder again",
    )
