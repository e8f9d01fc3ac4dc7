"""A piece of work of a long job: a function, what it reads, what it writes, and what must have ended before it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from counterflex.app.long_jobs.step_cache import Mark, fingerprint, program_files


@dataclass(frozen=True)
class Reads:
    """An argument that is a path, of a file or folder that is read; the function gets it as a text."""

    path: str


@dataclass(frozen=True)
class Writes:
    """The argument that is the path of the folder that is written; the function gets it as a text."""

    path: str


@dataclass(frozen=True)
class Task:
    """One piece of work.

    A task with an argument :class:`Writes` is kept on disk: when the job is started again and it was made from the same
    files, arguments and program, its function is not called again. It returns a table of plain values (JSON).
    """

    name: str
    text: str  # What is being worked on, for people
    function: Callable[..., Any]  # Of a module, so that a worker finds it
    # Plain values, :class:`Reads`, at most one :class:`Writes`; paths as plain texts only where all workers share this
    # machine's disk
    arguments: tuple[Any, ...] = ()
    after: tuple[str, ...] = ()  # Names of tasks that must have ended; their results are on disk
    weight: float = 1.0  # Expected time, in any unit
    tells: bool = False  # The function takes ``progress`` and tells the fraction done
    reads: tuple[str, ...] = ()  # Further files that it reads: those that the files named in its arguments name

    @property
    def writes(self) -> Path | None:
        """The folder that it writes."""
        return next((Path(item.path) for item in self.arguments if isinstance(item, Writes)), None)

    def files(self) -> tuple[Path, ...]:
        """The files that it reads, each once, folders with all that is in them."""
        named = [item.path for item in self.arguments if isinstance(item, Reads)]
        paths: list[Path] = []
        for path in map(Path, (*named, *self.reads)):
            paths += sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
        return tuple(dict.fromkeys(paths))

    def plain_arguments(self) -> tuple[Any, ...]:
        """Its arguments as the function takes them, on this machine."""
        return tuple(item.path if isinstance(item, Reads | Writes) else item for item in self.arguments)

    def mark(self) -> Mark:
        """What it is made from."""
        facts = [_plain(item) for item in self.arguments if not isinstance(item, Reads | Writes)]
        name = f"{self.function.__module__}.{self.function.__qualname__}"
        package = name.partition(".")[0]
        code = () if package == "counterflex" else program_files(package)
        return (*fingerprint(*self.files(), job=name, arguments=facts), *code)


@dataclass(frozen=True)
class Failed:
    """Result of a task that could not be done, or that waited for one."""

    why: str


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _plain(dataclasses.asdict(value))
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value
