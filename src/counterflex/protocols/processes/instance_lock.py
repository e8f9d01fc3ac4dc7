"""One loop at a time for a robot: a lock file that names who holds it and that the system gives back when he dies.

A loop that ends by itself leaves the file empty. What is found in a file that nobody holds is therefore of one that was
killed, or that ended while its correction was in effect: its robot program may still go on, without its correction.
"""

from __future__ import annotations

import json
import os
from io import TextIOWrapper
from pathlib import Path
from typing import Any, Final, Self

from counterflex.core.errors import OutputError
from counterflex.core.held import boot_id, own
from counterflex.core.user_folder import made_own, require_own

_LONGEST: Final = 4096
"""Longest text of a lock file that is read."""


class InstanceLock:
    """Held as long as it is open; the kernel frees it when its process ends, in whatever way.

    Args:
        folder: Of lock files of this user; made where it is missing.
        port: UDP port at which the robot's telegrams come.
        given: A person chose it; to one that the system chose no robot goes on sending after its loop.
        about: What else it says of its holder, for whoever looks for him.

    Attributes:
        not_closed: Folder of the log of the loop that held it before and did not close it, in this start of the
            machine; "" where there is none.
        last: What this loop answers last, for the next one; and what that one did.

    Raises:
        OutputError: Another process holds it, or the folder cannot be written, or others can write into it.
    """

    def __init__(self, folder: Path, port: int, *, given: bool = True, **about: str) -> None:
        # with NumPy: what only looks for the holders, `operator stop`, does not wait for it
        from counterflex.protocols.processes.last_answer import LastAnswer

        self.path = folder / f"robot-{port}.lock"
        try:
            made_own(folder)
            stream = self.path.open("a+", encoding="utf-8")
        except OutputError:
            raise
        except OSError as fault:
            raise OutputError(f"no lock can be made: {fault.strerror or fault}", where=str(self.path)) from fault
        if not own(stream.fileno()):
            holder = _holder(stream)
            stream.close()
            raise OutputError(
                "another loop answers this robot",
                where=f"port {port}",
                value=holder,
                hint="One at a time: end the other one first",
            )
        self._stream = stream
        stream.seek(0)
        self._former = stream.read(_LONGEST)
        self.not_closed = _left(self._former) if given else ""
        self.last = LastAnswer.at_lock(self.path, fresh=not self.not_closed)
        stream.seek(0)
        stream.truncate()
        stream.write(json.dumps({"pid": os.getpid(), "boot": boot_id(), "given": given, **about}) + "\n")
        stream.flush()

    def __enter__(self) -> Self:
        """The lock."""
        return self

    def __exit__(self, *_: object) -> None:
        """Give it back."""
        self.close()

    def close(self, *, ended: bool = True, acknowledged: bool = True) -> None:
        """Give it back; the file stays, empty.

        Args:
            ended: Nothing is in effect at the robot. Else the file keeps its entry, for the next loop.
            acknowledged: A person has seen what the loop before left, or it left nothing. Else its entry is kept.
        """
        if not self._stream.closed:
            self.last.close(keep=not (ended and acknowledged))
            if ended:
                self._stream.seek(0)
                self._stream.truncate()
                self._stream.write("" if acknowledged else self._former)
            self._stream.close()


def holders(folder: Path) -> list[dict[str, Any]]:
    """Return the content of the lock files of a folder; none where others can write into it."""
    locks: list[dict[str, Any]] = []
    try:
        require_own(folder)
    except OSError:
        return locks
    for path in sorted(folder.glob("robot-*.lock")):
        try:
            content = json.loads(path.read_text(encoding="utf-8")[:_LONGEST])
        except (ValueError, OSError):
            continue
        if isinstance(content, dict):
            locks.append(content)
    return locks


def _left(text: str) -> str:
    """Folder of the log of the loop that has left an entry; ``"unknown"`` where that cannot be read."""
    if not text.strip():
        return ""
    try:
        entry = json.loads(text)
        if not isinstance(entry, dict):
            return "unknown"
        counts = entry.get("boot") == boot_id() and entry.get("given") is not False
        return str(entry.get("run") or "unknown") if counts else ""
    except (ValueError, RecursionError):
        return "unknown"


def _holder(stream: TextIOWrapper) -> str:
    stream.seek(0)
    try:
        return f"process {int(json.loads(stream.read(_LONGEST))['pid'])}"
    except (ValueError, KeyError, TypeError, OSError):
        return "process not known"
