"""Files that are read, changed and written again: one process at a time.

A file that is replaced by a rename cannot be locked itself: the next one would lock the file that was replaced. Its
folder is locked instead; where folders cannot be opened (Windows), a file beside it that is removed afterwards.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from counterflex.core import held
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
        wait: Waits for so many s.

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
        while handle is not None and held.own(handle) is False:
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
