"""A task on a worker of a cluster: its files in a folder of its own, what it wrote and returned as bytes back."""

from __future__ import annotations

import hashlib
import io
import json
import tempfile
import traceback
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any, Final

from counterflex import __version__
from counterflex.app.long_jobs.executors import call
from counterflex.app.long_jobs.step_cache import program_files
from counterflex.app.long_jobs.task import Reads, Task, Writes
from counterflex.core import atomic, errors, file_content
from counterflex.core.errors import CounterflexError, FileFormatError, InputError
from counterflex.core.progress import Progress, silent

LARGEST_BYTES: Final = 2**30
"""Files of one task, unpacked: more than any step of a job writes, less than fills a machine's memory."""
_FACTS: Final = "facts.json"
_FILES: Final = "files/"


def name_below(root: Path, path: Path) -> str:
    """Name of a file or folder below a folder, with slashes.

    Raises:
        InputError: It is not below it; nothing else of this machine is sent to workers.
    """
    try:
        return path.absolute().relative_to(root.absolute()).as_posix()
    except ValueError:
        raise InputError(
            "a file of a task lies outside the folder of its job", where=str(path), limit=str(root)
        ) from None


def packed(root: Path, files: Iterable[Path], facts: Mapping[str, Any]) -> bytes:
    """Files and plain facts as the bytes of a ZIP archive.

    Args:
        root: Folder that the names of the files are relative to.

    Raises:
        InputError: A file is not below the folder.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr(_FACTS, json.dumps(facts, allow_nan=False))
        for file in files:
            try:
                archive.writestr(_FILES + name_below(root, file), file_content.content(file))
            except OSError as fault:
                raise FileFormatError(f"cannot be read: {fault.strerror or fault}", where=str(file)) from fault
    return data.getvalue()


def unpacked(data: object, root: Path, below: str | None = None) -> dict[str, Any]:
    """Write the files of a parcel below a folder, each whole or not at all, and return its facts.

    Nothing is unpickled, and no file gets out of the folder, whoever made the parcel.

    Args:
        below: Folder below it that all files must lie in; None takes any.

    Raises:
        FileFormatError: It is no such archive, is too large, or a name leads elsewhere.
        OutputError: A file cannot be written.
    """
    if not isinstance(data, bytes):
        raise FileFormatError("a worker answered with something that is no parcel of files", value=type(data).__name__)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(item.file_size for item in archive.infolist())
            if size > LARGEST_BYTES:
                raise FileFormatError("the files of a task are too large", value=f"{size} bytes", limit=LARGEST_BYTES)
            facts = json.loads(archive.read(_FACTS))
            names = [item.filename for item in archive.infolist() if item.filename.startswith(_FILES)]
            targets = [(name, _target(root, name.removeprefix(_FILES), below)) for name in names]
            for name, target in targets:
                atomic.write_bytes(target, archive.read(name))
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as fault:
        if isinstance(fault, FileFormatError):
            raise
        raise FileFormatError("a parcel of files is damaged", value=str(fault)[:80]) from fault
    if not isinstance(facts, dict):
        raise FileFormatError("a parcel of files has no facts")
    return facts


def _target(root: Path, name: str, below: str | None) -> Path:
    parts = PurePosixPath(name).parts
    outside = not parts or ".." in parts or "\\" in name or ":" in name or PurePosixPath(name).is_absolute()
    if outside or (below is not None and parts[: len(PurePosixPath(below).parts)] != PurePosixPath(below).parts):
        raise FileFormatError("a parcel holds a file that is not of its task", value=name, limit=below)
    return root.joinpath(*parts)


@dataclass(frozen=True)
class WorkOrder:
    """A task on its way to a worker."""

    task: Task  # With paths relative to the folder of the job
    files: bytes  # What it reads, as :func:`counterflex.app.long_jobs.on_worker.packed` packs it
    root: str  # The folder of the job on the machine that ordered it, for messages
    program: str  # :func:`program_now` there

    def carry_out(self, progress: Progress = silent, scratch: str | None = None) -> bytes:
        """Do a task.

        Args:
            progress: Called with the fraction done.
            scratch: Folder for its files while it runs; None is that of the system.

        Returns:
            Parcel of the files that it wrote and ``result``, or ``fault``, or ``other`` where this is another program;
            it never raises what a task raised, so that the other side has nothing to unpickle.
        """
        if self.program != program_now():
            return packed(Path(), (), {"other": program_now(), "rooms": dict(program_files())})
        with tempfile.TemporaryDirectory(prefix="counterflex-", dir=scratch, ignore_cleanup_errors=True) as folder:
            root = Path(folder).resolve()
            arguments = tuple(
                type(item)(str(root / item.path)) if isinstance(item, Reads | Writes) else item
                for item in self.task.arguments
            )
            task = Task(self.task.name, self.task.text, self.task.function, arguments, tells=self.task.tells)
            try:
                unpacked(self.files, root)
                if task.writes is not None:
                    task.writes.mkdir(parents=True, exist_ok=True)
                result = call(task, progress)
                written = [] if task.writes is None else [file for file in task.writes.rglob("*") if file.is_file()]
                return packed(root, written, {"result": result})
            except CounterflexError as fault:
                return packed(root, (), {"fault": _plain(fault, str(root), self.root)})
            except Exception as fault:
                text = "".join(traceback.format_exception(fault)).replace(str(root), self.root)
                return packed(root, (), {"broken": f"{type(fault).__name__}: {fault}", "traceback": text})


@cache
def program_now() -> str:
    """Version and contents of the program that computes here, in one line that differs where they do."""
    rooms = "\n".join(f"{room} {digest}" for room, digest in program_files())
    return f"{__version__} ({hashlib.sha256(rooms.encode()).hexdigest()[:12]})"


def ordered(task: Task, root: Path) -> WorkOrder:
    """A task with everything that it needs. Raises InputError: a file is not below the folder of the job."""
    arguments = tuple(
        type(item)(name_below(root, Path(item.path))) if isinstance(item, Reads | Writes) else item
        for item in task.arguments
    )
    files = packed(root, task.files(), {})
    sent = Task(task.name, task.text, task.function, arguments, weight=task.weight, tells=task.tells)
    return WorkOrder(sent, files, str(root), program_now())


def taken(parcel: object, task: Task, root: Path) -> Any:
    """Return what a task returned, its files written to their places; or the exception that it raised.

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
    return {"kind": type(fault).__name__} | {
        k: None if v is None else _moved(str(v), there, here) for k, v in texts.items()
    }


def _moved(text: str, there: str, here: str) -> str:
    return text.replace(there, here) if there else text


def _fault(plain: dict[str, Any]) -> CounterflexError:
    kinds: dict[str, Callable[..., CounterflexError]] = {
        name: kind
        for name, kind in vars(errors).items()
        if isinstance(kind, type) and issubclass(kind, CounterflexError)
    }
    kind = kinds.get(str(plain.get("kind")), CounterflexError)
    return kind(str(plain.get("what")), **{key: plain.get(key) for key in ("where", "value", "limit", "hint")})
