"""Commands of a project: one child process after another, with progress and cancel."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import subprocess
import sys
import threading
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

from counterflex.core.printable import printable

State = Literal["waiting", "running", "done", "checked", "failed", "cancelled"]
LOG: Final = "studio-commands.txt"
"""File of the project that lists what was run, with the exit status."""
_PROGRESS: Final = re.compile(r"^(?P<what>.*): (?P<percent>\d+) %(?P<left>, about .* left)?$")
_LINES: Final = 400
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
    """Runs commands in the order in which they were asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._ready = threading.Condition()
        self._process: subprocess.Popen[str] | None = None
        self._closed = False
        self.jobs: list[QueuedCommand] = []
        self.version = 0  # Counts changes of states
        self._worker = threading.Thread(target=self._work, name="studio commands", daemon=True)
        self._worker.start()

    def add(self, line: str) -> QueuedCommand:
        """CommandQueue a command line, ``counterflex ...`` as it would be typed."""
        job = QueuedCommand(line)
        with self._ready:
            self.jobs.append(job)
            self.version += 1
            self._ready.notify()
        return job

    def cancel(self, job: QueuedCommand) -> None:
        """End a command: it leaves nothing half-written. One that waits is not begun."""
        with self._ready:
            if job.state == "waiting":
                job.state = "cancelled"
            elif job.state == "running" and self._process is not None:
                job.state = "cancelled"
                with contextlib.suppress(OSError):
                    self._process.terminate()
            self.version += 1

    def close(self) -> None:
        """End everything."""
        with self._ready:
            self._closed = True
            self._ready.notify()
        for job in self.jobs:
            if not job.ended:
                self.cancel(job)
        self._worker.join(timeout=10.0)

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
            self._follow(job, self._process)

    def _begin(self, job: QueuedCommand) -> subprocess.Popen[str]:
        words = shlex.split(job.line)[1:]
        environment = {**os.environ, "COUNTERFLEX_PROGRESS_S": _PERIOD_S, "COLUMNS": "120", "PYTHONIOENCODING": "utf-8"}
        return subprocess.Popen(
            [sys.executable, "-m", "counterflex", *words], cwd=self._folder, env=environment,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, encoding="utf-8", errors="replace",
        )  # fmt: skip

    def _follow(self, job: QueuedCommand, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            job.take(line.rstrip("\n"))
        status = process.wait()
        process.stdout.close()
        with self._ready:
            self._process, job.status = None, status
            if job.state == "running":
                checked = status == _FAILED_CHECK and not any(line.startswith("Traceback") for line in job.lines)
                job.state = "done" if status == 0 else "checked" if checked else "failed"
            self.version += 1
        with (
            contextlib.suppress(OSError),
            (self._folder / LOG).open("a", encoding="utf-8", errors="surrogateescape") as file,
        ):
            file.write(f"{job.line}  # exit {status}\n")
