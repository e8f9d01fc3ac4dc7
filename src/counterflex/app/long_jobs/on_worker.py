"""A task on a worker of a cluster: its files in a folder of its own, what it wrote and returned as bytes back."""

from __future__ import annotations

import hashlib
import tempfile
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from counterflex import __version__
from counterflex.app.long_jobs.executors import call
from counterflex.app.long_jobs.parcel import name_below, packed, unpacked
from counterflex.app.long_jobs.step_cache import program_files
from counterflex.app.long_jobs.task import Reads, Task, Writes
from counterflex.core import errors
from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.progress import Progress, silent


@dataclass(frozen=True)
class Order:
    """A task on its way to a worker.

    Attributes:
        task: With paths relative to the folder of the job.
        files: What it reads, as :func:`counterflex.app.long_jobs.parcel.packed` packs it.
        root: The folder of the job on the machine that ordered it, for messages.
        program: :func:`program_now` there.
    """

    task: Task
    files: bytes
    root: str
    program: str


@cache
def program_now() -> str:
    """Version and contents of the program that computes here, in one line that differs where they do."""
    rooms = "\n".join(f"{room} {digest}" for room, digest in program_files())
    return f"{__version__} ({hashlib.sha256(rooms.encode()).hexdigest()[:12]})"


def ordered(task: Task, root: Path) -> Order:
    """A task with everything that it needs.

    Raises:
        InputError: A file is not below the folder of the job.
        FileFormatError: A file cannot be read.
    """
    arguments = tuple(
        type(item)(name_below(root, Path(item.path))) if isinstance(item, Reads | Writes) else item
        for item in task.arguments
    )
    files = packed(root, task.files(), {})
    sent = Task(task.name, task.text, task.function, arguments, weight=task.weight, tells=task.tells)
    return Order(sent, files, str(root), program_now())


def carried_out(order: Order, progress: Progress = silent, scratch: str | None = None) -> bytes:
    """Do a task.

    Args:
        order: The task.
        progress: Called with the fraction done.
        scratch: Folder for its files while it runs; None is that of the system.

    Returns:
        Parcel of the files that it wrote and ``result``, or ``fault``, or ``other`` where this is another program; it
        never raises what a task raised, so that the other side has nothing to unpickle.
    """
    if order.program != program_now():
        return packed(Path(), (), {"other": program_now(), "rooms": dict(program_files())})
    with tempfile.TemporaryDirectory(prefix="counterflex-", dir=scratch, ignore_cleanup_errors=True) as folder:
        root = Path(folder).resolve()
        arguments = tuple(
            type(item)(str(root / item.path)) if isinstance(item, Reads | Writes) else item
            for item in order.task.arguments
        )
        task = Task(order.task.name, order.task.text, order.task.function, arguments, tells=order.task.tells)
        try:
            unpacked(order.files, root)
            if task.writes is not None:
                task.writes.mkdir(parents=True, exist_ok=True)
            result = call(task, progress)
            written = [] if task.writes is None else [file for file in task.writes.rglob("*") if file.is_file()]
            return packed(root, written, {"result": result})
        except CounterflexError as fault:
            return packed(root, (), {"fault": _plain(fault, str(root), order.root)})
        except Exception as fault:
            text = "".join(traceback.format_exception(fault)).replace(str(root), order.root)
            return packed(root, (), {"broken": f"{type(fault).__name__}: {fault}", "traceback": text})


def taken(parcel: object, task: Task, root: Path) -> Any:
    """What a task returned, its files written to their places; or the exception that it raised.

    Args:
        parcel: As :func:`carried_out` made it.
        task: Of this machine.
        root: The folder of the job.

    Raises:
        InputError: The worker runs another program; no task would be the same there.
        FileFormatError: It is no such parcel.
        OutputError: A file cannot be written.
    """
    facts = unpacked(parcel, root, None if task.writes is None else name_below(root, task.writes))
    if "other" in facts:
        raise InputError(
            "a worker runs another counterflex than this machine",
            where=_different(facts.get("rooms")),
            value=facts["other"],
            limit=program_now(),
            hint="Install the same on both, and leave its files alone while a job runs",
        )
    if "fault" in facts:
        return _fault(facts["fault"])
    if "broken" in facts:
        return RuntimeError(f"{facts['broken']}\nOn a worker:\n{facts.get('traceback', '')}")
    return facts.get("result")


def _different(there: object) -> str | None:
    """Rooms of the program that differ between a worker and this machine; None where that is not known."""
    here = dict(program_files())
    if not isinstance(there, dict):
        return None
    rooms = sorted(str(room) for room in here.keys() | there.keys() if here.get(room) != there.get(room))
    return ", ".join(rooms) or None


def _plain(fault: CounterflexError, there: str, here: str) -> dict[str, str | None]:
    texts = {key: getattr(fault, key) for key in ("what", "where", "value", "limit", "hint")}

    def moved(text: str) -> str:
        return text.replace(there, here) if there else text

    return {"kind": type(fault).__name__} | {k: None if v is None else moved(str(v)) for k, v in texts.items()}


def _fault(plain: dict[str, Any]) -> CounterflexError:
    kinds: dict[str, Callable[..., CounterflexError]] = {
        name: kind
        for name, kind in vars(errors).items()
        if isinstance(kind, type) and issubclass(kind, CounterflexError)
    }
    kind = kinds.get(str(plain.get("kind")), CounterflexError)
    return kind(str(plain.get("what")), **{key: plain.get(key) for key in ("where", "value", "limit", "hint")})
