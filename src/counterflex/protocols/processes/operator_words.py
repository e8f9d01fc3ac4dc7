"""File in the folder of a run by which an operator finds the numbers that the run's processes share.

A request is a number written into them, and the loop itself reads it in its next cycle: no other process has to live
for it. Who may write is decided by the rights of the file behind the memory: this user, on this computer. What stands
there is a number or nothing; there is no text that could be rubbish.
"""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import Final

from counterflex.core.errors import FileFormatError, InputError, OutputError
from counterflex.protocols.processes.control_array import CONTROL
from counterflex.protocols.processes.instance_lock import holders
from counterflex.protocols.processes.shared_words import SharedWords, words_of

FILE: Final = "operator.json"


class OperatorFile:
    """The run's side: the file, as long as the run goes on.

    Args:
        words: Where the shared numbers are.

    Raises:
        OutputError: It cannot be written.
    """

    def __init__(self, folder: Path, words: Path) -> None:
        self.path = folder / FILE
        try:
            self.path.unlink(missing_ok=True)
            with os.fdopen(os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
                stream.write(json.dumps({"words": str(words), "pid": os.getpid()}) + "\n")
        except OSError as fault:
            raise OutputError(f"cannot be written: {fault.strerror or fault}", where=str(self.path)) from fault

    def close(self) -> None:
        """Nobody finds the run any more."""
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)


def find(folder: Path, locks: Path) -> SharedWords:
    """The shared numbers of the run whose log lies in a folder, or lay there: the folder may have been removed.

    Args:
        folder: As ``run`` was given it.
        locks: Folder of the loops' lock files (:class:`counterflex.protocols.processes.instance_lock.InstanceLock`).

    Raises:
        FileFormatError: No run goes on there, or its file is none.
    """
    path = folder / FILE
    try:
        words: Path | None = words_of(path)[0]
    except (FileNotFoundError, NotADirectoryError) as fault:
        words = _locked(folder, locks)
        if words is None:
            raise FileFormatError(
                "no run goes on there", where=str(folder), hint="Give the folder that the run was given as its --out"
            ) from fault
    except OSError as fault:
        raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(path)) from fault
    except ValueError as fault:
        raise FileFormatError("is not the file of a run that goes on", where=str(path)) from fault
    try:
        return SharedWords(CONTROL, words)
    except InputError as fault:
        raise FileFormatError(
            "no run goes on there: the one that wrote this file has ended without removing it",
            where=str(path),
            hint="A robot that still moves is stopped at its own controller",
        ) from fault


def _locked(folder: Path, locks: Path) -> Path | None:
    """By the lock of the loop, which stands elsewhere."""
    run = str(folder.absolute())
    for lock in holders(locks):
        words = lock.get("words")
        if lock.get("run") == run and isinstance(words, str) and Path(words).exists():
            return Path(words)
    return None
