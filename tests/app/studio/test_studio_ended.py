"""The studio ends, or is killed, while a command runs: the command ends with it and is told at the next start."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from counterflex.app import examples
from counterflex.app.studio import jobs
from counterflex.app.studio.jobs import LOG, CommandQueue
from counterflex.core.errors import OutputError

HELD_S = 120.0
LINE = "counterflex prove part.ngc --cell cell.toml --out proof --seeds 50 --workers 1"
BY_ITSELF = """
import sys, threading
from counterflex.app.studio.jobs import CommandQueue
from pathlib import Path
queue = CommandQueue(Path("."))
"""
SERVED = """
import sys, threading
from counterflex.app.panel.settings import PanelSettings
from counterflex.app.studio.server import StudioServer
from counterflex.cli.interrupt import interruptible
from pathlib import Path
server = StudioServer(PanelSettings(Path("."), port=0), lambda links: served.set())
queue, served = server._queue, threading.Event()
"""
TELLS = f"""
job = queue.add({LINE!r})
def tell():
    while not job.what:  # the command computes
        threading.Event().wait(0.02)
    {{wait}}
    print(queue._process.pid, flush=True)
threading.Thread(target=tell, daemon=True).start()
"""


def begun(folder: Path, code: str, wait: str, then: str) -> tuple[subprocess.Popen[str], int]:
    """A process with a queue whose command computes; it, and a handle of the command."""
    starter = subprocess.Popen(
        [sys.executable, "-c", code + TELLS.format(wait=wait) + then], cwd=folder, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert starter.stdout is not None
    return starter, os.pidfd_open(int(starter.stdout.readline()))


def require_ended(starter: subprocess.Popen[str], command: int) -> None:
    """Both processes end."""
    starter.wait(HELD_S)
    assert starter.stdout is not None
    starter.stdout.close()
    assert select.select([command], [], [], HELD_S)[0]
    os.close(command)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A project."""
    examples.write_all(tmp_path / "cell.toml")
    return tmp_path


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_a_studio_that_is_stopped_asks_its_command_to_end(folder: Path, number: int) -> None:
    pytest.importorskip("nicegui", reason="the extra panel is not installed")
    before = {path.name for path in folder.iterdir()}
    code = "with interruptible():\n    try: server.serve()\n    except KeyboardInterrupt: pass\n"
    code += "print(job.state, job.status, job.error, flush=True)\n"
    starter, command = begun(folder, SERVED, "served.wait()", code)
    starter.send_signal(number)
    assert starter.stdout is not None
    assert starter.stdout.read().startswith("interrupted 143 interrupted")  # its own interrupt, not a kill
    require_ended(starter, command)
    assert {path.name for path in folder.iterdir()} - {LOG} == before
    assert (folder / LOG).read_text(encoding="utf-8") == f"{LINE}  # interrupted\n"


def test_the_command_of_a_studio_that_is_killed_ends_and_is_told_at_the_next_start(folder: Path) -> None:
    starter, command = begun(folder, BY_ITSELF, "", "threading.Event().wait()\n")
    with pytest.raises(OutputError, match="another studio"):
        CommandQueue(folder)
    starter.kill()
    require_ended(starter, command)
    assert (folder / LOG).read_text(encoding="utf-8") == LINE
    for _ in range(2):  # until it has run again, or something else has
        queue = CommandQueue(folder)
        queue.close()
        assert [(job.line, job.state) for job in queue.jobs] == [(LINE, "interrupted")]
    assert (folder / LOG).read_text(encoding="utf-8") == f"{LINE}  # interrupted\n"


def test_what_runs_again_is_no_longer_interrupted(tmp_path: Path) -> None:
    line = "counterflex robots --no-such-option"
    (tmp_path / LOG).write_text(f"{LINE}  # exit 0\nrm -r ~  # interrupted\n{line}  # interrupted\n", encoding="utf-8")
    queue = CommandQueue(tmp_path)
    assert [job.line for job in queue.jobs] == [line]
    again = queue.add(line)
    while not again.ended:
        queue._worker.join(0.02)
    queue.close()
    assert queue.jobs == [again]
    assert again.state == "failed"
    queue = CommandQueue(tmp_path)
    queue.close()
    assert queue.jobs == []


def test_a_command_that_does_not_end_when_asked_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ignores the end of its input and every signal that can be ignored."""
    code = "import signal, threading; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('on', flush=True)"
    monkeypatch.setattr(jobs, "_PROGRAM", [sys.executable, "-c", f"{code}; threading.Event().wait()"])
    monkeypatch.setattr(jobs, "GRACE_S", 0.1)
    queue = CommandQueue(tmp_path)
    job = queue.add("counterflex robots")
    while not job.lines:
        queue._worker.join(0.02)
    queue.close()
    assert (job.state, job.status) == ("interrupted", -signal.SIGKILL)


def test_a_file_of_the_project_is_not_imported(tmp_path: Path) -> None:
    """Whoever sends a program to mill may send a numpy.py beside it."""
    for name in ("numpy", "typer", "counterflex"):
        (tmp_path / f"{name}.py").write_text("open('imported', 'w').close()\n", encoding="ascii")
    queue = CommandQueue(tmp_path)
    job = queue.add("counterflex cell example --out cell.toml")
    while not job.ended:
        queue._worker.join(0.02)
    queue.close()
    assert job.state == "done", list(job.lines)
    assert not (tmp_path / "imported").exists()
