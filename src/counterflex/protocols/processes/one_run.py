"""One run to a folder: two would share the file by which an operator finds the run, and a stop would reach one only."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import Final

from counterflex.core.errors import InputError, OutputError
from counterflex.core.held import own
from counterflex.core.output_place import process_lives
from counterflex.protocols.processes.control_array import CONTROL, Life
from counterflex.protocols.processes.operator_words import FILE
from counterflex.protocols.processes.shared_words import SharedWords, words_of

LOCK: Final = ".run.lock"
"""File in the folder that a run holds (:mod:`counterflex.core.held`) from before it starts anything to its end."""
_SILENT_NS: Final = 1_000_000_000
"""A loop that has said nothing for so long has ended, where the process that started it has, too."""


class OneRun:
    """A folder, held for one run; the kernel frees it when the process dies.

    What a killed run has left there is no run; one whose loop still speaks is, though the process that started it is
    gone.

    Args:
        folder: Of the run; made where it is missing.

    Raises:
        OutputError: Another run goes on there, or it cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._path, self._made = folder / LOCK, _missing(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._handle, locked = self._locked_handle(folder)
        except OutputError:
            self._unmake()
            raise
        except OSError as fault:
            self._unmake()
            raise OutputError(
                f"the run log cannot be written: {fault.strerror or fault}",
                where=str(folder),
                hint="Choose another --out, or make room there",
            ) from fault
        try:
            _require_free(folder, locked=locked)
        except OutputError:
            self.close()
            raise

    def _locked_handle(self, folder: Path) -> tuple[int, bool]:
        """A handle of the file that has this name: one that has just been given back is no lock any more.

        And whether it is held, which not every file system can do.
        """
        while True:
            handle = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
            locked = own(handle)
            if locked is False:
                os.close(handle)
                raise _refused(folder, _holder(folder))
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), self._path.stat()):
                    return handle, bool(locked)
            os.close(handle)

    def close(self) -> None:
        """Give it back; a folder that was made for the run and into which nothing was written is removed."""
        if os.name != "posix":  # there an open file cannot be removed
            os.close(self._handle)
        with contextlib.suppress(OSError):
            if os.name != "posix" or os.path.samestat(os.fstat(self._handle), self._path.stat()):
                self._path.unlink()
        if os.name == "posix":
            os.close(self._handle)
        self._unmake()

    def _unmake(self) -> None:
        with contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()


def _missing(folder: Path) -> list[Path]:
    """The folder and those above it that are not there yet, the innermost first."""
    out = []
    for one in (folder, *folder.parents):
        if one.exists():
            break
        out.append(one)
    return out


def _operator_entry(folder: Path) -> tuple[Path, int] | None:
    """Path of the run's shared numbers that an operator would find there, and its process."""
    try:
        return words_of(folder / FILE)
    except (OSError, ValueError):
        return None


def _holder(folder: Path) -> str:
    entry = _operator_entry(folder)
    return "it is being started" if entry is None else f"process {entry[1]}"


def _require_free(folder: Path, *, locked: bool) -> None:
    """No run goes on there whose first process is gone; without locks, also none whose first process lives."""
    entry = _operator_entry(folder)
    if entry is None:
        return
    words, pid = entry
    try:
        with SharedWords(CONTROL, words) as shared:
            silent_ns = time.monotonic_ns() - shared.words[Life.LOOP_NS]
    except InputError:
        return
    if silent_ns < _SILENT_NS or (not locked and process_lives(pid)):
        raise _refused(folder, f"process {pid}")


def _refused(folder: Path, value: str) -> OutputError:
    return OutputError(
        "another run goes on in this folder",
        where=str(folder),
        value=value,
        hint="Give another folder with --out, or wait until that run has ended",
    )
