"""A process that is killed before the change of a given number that it makes in the file system, for every number."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

KILLED: Final = 9
CHANGES: Final = ("replace", "mkdir", "unlink", "rmdir", "write_text", "chmod")
"""Methods of paths that change what is there."""


@contextmanager
def counted(number: int, act: Callable[[], object], changes: tuple[str, ...] = CHANGES) -> Iterator[None]:
    """Call something before the change of that number that the process makes in the file system."""
    count, before = [0], {name: getattr(Path, name) for name in changes}

    def counting(name: str) -> Callable[..., Any]:
        def change(self: Path, *args: Any, **options: Any) -> Any:
            count[0] += 1
            if count[0] == number:
                act()
            return before[name](self, *args, **options)

        return change

    for name in changes:
        setattr(Path, name, counting(name))
    try:
        yield
    finally:
        for name in changes:
            setattr(Path, name, before[name])


def killed(number: int, job: Callable[[], object], changes: tuple[str, ...] = CHANGES) -> bool:
    """Do a job in a process that is killed before its change of that number; False: it ended before."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            with counted(number, lambda: os._exit(KILLED), changes):
                job()
            status = 0
        finally:
            os._exit(status)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in (0, KILLED)
    return status == KILLED


def each_kill(job: Callable[[], object], changes: tuple[str, ...] = CHANGES) -> Iterator[int]:
    """Numbers of the changes that a job makes, each after a process was killed before it."""
    number = 1
    while killed(number, job, changes):
        yield number
        number += 1
    assert number > 1
