"""Commands of a project: one child process after another, with progress and cancel."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, TextIO

from counterflex.core import file_content, held
from counterflex.core.errors import OutputError
from counterflex.core.printable import printable

State = Literal["waiting", "running", "done", "checked", "failed", "cancelled", "interrupted"]
LOG: Final = "studio-commands.txt"
"""File of the project that lists what was run, with the exit status; of what still runs without one."""
GRACE_S: Final = 10.0
"""Time that a command has to end by itself, keeping what it can, before it is killed."""
_INTERRUPTED: Final = "interrupted"
_PROGRAM: Final = [sys.executable, "-P", "-m", "counterflex"]
"""-P: nothing is imported from the folder of the project, where files of others may lie."""
_PROGRESS: Final = re.compile(r"^(?P<what>.*): (?P<percent>\d+) %(?P<left>, about .* left)?$")
_LINES: Final = 400
_KNOWN: Final = 30
"""Lines at the end of the list in which interrupted commands are looked for."""
_PERIOD_S: Final = "0.5"
_FAILED_CHECK: Final = 1
"""Exit status of a command whose check failed; what it writes is whole."""


@dataclass(eq=False)
class QueuedCommand:
    """A command line in the folder of the project."""

    line: str
    state: State = "waiting"
    status: int | None = None
    fraction: float = 0.0
    what: str = ""  # What is being done, with the time left
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_LINES))

    @property
    def ended(self) -> bool:
        """It runs no longer, and will not."""
        return self.state not in ("waiting", "running")

    @property
    def error(self) -> str:
        """Fault that the command names; empty where it ended well."""
        messages = [line for line in self.lines if line.startswith("error: ")]
        return messages[-1].removeprefix("error: ") if messages else ""

    def take(self, line: str) -> None:
        """Take a line that the command prints."""
        match = _PROGRESS.match(line)
        if match is None:
            self.lines.append(printable(line))
        else:
            self.fraction, self.what = int(match["percent"]) / 100.0, match["what"] + (match["left"] or "")


class CommandQueue:
    """Runs commands in the order in which they were asked for.

    A command ends with the studio: the pipe on its standard input closes when the studio asks for it, or has died.

    Raises:
        OutputError: Another studio works in the folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._ready = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._closed = False
        self._log = self._opened()
        self.jobs = [] if self._log is None else self._interrupted()
        self.version = 0  # Counts changes of states
        self._worker = threading.Thread(target=self._work, name="studio commands", daemon=True)
        self._worker.start()

    def add(self, line: str) -> QueuedCommand:
        """CommandQueue a command line, ``counterflex ...`` as it would be typed."""
        job = QueuedCommand(line)
        with self._ready:
            self.jobs = [one for one in self.jobs if one.state != "interrupted" or one.line != line]
            self.jobs.append(job)
            self.version += 1
            self._ready.notify()
        return job

    @property
    def closed(self) -> bool:
        """The studio ends."""
        return self._closed

    def cancel(self, job: QueuedCommand) -> None:
        """End a command: it leaves nothing half-written. One that waits is not begun."""
        with self._ready:
            self._end(job, "cancelled")

    def close(self) -> None:
        """End everything, and wait for it; the command that runs is told as interrupted at the next start."""
        with self._ready:
            self._closed = True
            self._ready.notify()
            for job in self.jobs:
                self._end(job, "interrupted")
        self._worker.join(GRACE_S + 5.0)
        if self._log is not None:
            self._log.close()

    def _end(self, job: QueuedCommand, state: State) -> None:
        process = self._process
        if not job.ended:
            if job.state == "running" and process is not None and process.stdin is not None:
                process.stdin.close()
                killer = threading.Timer(GRACE_S, _kill, (process,))
                killer.daemon = True
                killer.start()
            job.state = state
        self.version += 1

    def _work(self) -> None:
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._closed or any(job.state == "waiting" for job in self.jobs))
                if self._closed:
                    return
                job = next(one for one in self.jobs if one.state == "waiting")
                job.state = "running"
                self.version += 1
                try:
                    self._process = self._begin(job)
                except (OSError, ValueError) as fault:  # no process, or a name that none can be given
                    job.lines.append(f"error: cannot run: {printable(str(fault))}")
                    job.state = "failed"
                    self.version += 1
                    continue
            self._note(job.line)
            self._follow(job, self._process)

    def _begin(self, job: QueuedCommand) -> subprocess.Popen[str]:
        words = shlex.split(job.line)[1:]
        environment = {
            **os.environ, "COUNTERFLEX_PROGRESS_S": _PERIOD_S, "COUNTERFLEX_ENDS_WITH_STDIN": "1", "COLUMNS": "120",
            "PYTHONIOENCODING": "utf-8",
        }  # fmt: skip
        return subprocess.Popen(
            [*_PROGRAM, *words], cwd=self._folder, env=environment,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, encoding="utf-8", errors="replace",
            # Ctrl-C in the terminal of the studio reaches the studio alone, which asks the command once.
            start_new_session=True, creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )  # fmt: skip

    def _follow(self, job: QueuedCommand, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        assert process.stdin is not None
        for line in process.stdout:
            job.take(line.rstrip("\n"))
        status = process.wait()
        process.stdout.close()
        process.stdin.close()
        with self._ready:
            self._process, job.status = None, status
            if job.state == "running":
                checked = status == _FAILED_CHECK and not any(line.startswith("Traceback") for line in job.lines)
                job.state = "done" if status == 0 else "checked" if checked else "failed"
            self.version += 1
        self._note(f"  # {_INTERRUPTED if job.state == 'interrupted' else f'exit {status}'}\n")

    def _note(self, text: str) -> None:
        if self._log is not None:
            with contextlib.suppress(OSError):
                self._log.write(text)
                self._log.flush()

    def _opened(self) -> TextIO | None:
        """Open the list, held as long as the studio lives; None where it cannot be written."""
        path = self._folder / LOG
        try:
            log = path.open("a", encoding="utf-8", errors="surrogateescape")
        except OSError:
            return None
        if held.own(log.fileno()) is False:
            log.close()
            raise OutputError(
                "another studio works in this folder", where=str(path), hint="Open its page, or close it first"
            )
        return log

    def _interrupted(self) -> list[QueuedCommand]:
        """Commands at the end of the list that did not end by themselves; a line that was cut short is completed."""
        lines = file_content.content(self._folder / LOG).decode("utf-8", "surrogateescape").split("\n")
        cut = [last] if (last := lines.pop()) else []
        if cut:
            self._note(f"  # {_INTERRUPTED}\n")
        known: list[QueuedCommand] = []
        for line in reversed([*lines[-_KNOWN:], *cut]):
            command, mark, end = line.rstrip("\r").rpartition("  # ")
            if mark and end != _INTERRUPTED:
                break
            if (command or line).startswith("counterflex "):
                known.append(QueuedCommand(command or line, "interrupted"))
        return known[::-1]


def _kill(process: subprocess.Popen[str]) -> None:
    """End a command that does not end by itself, and what it has started."""
    if process.poll() is None:
        with contextlib.suppress(OSError):
            if hasattr(os, "killpg"):
                os.killpg(process.pid, signal.SIGKILL)  # it leads its own group
            else:
                process.kill()
