"""Interrupted jobs: one line, status 130 or 143, nothing left behind, no process left running."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from counterflex.core.progress import Progress

SAID = "error: interrupted; nothing was written\n"


def _stops_at(at: float) -> Any:
    """A progress bar whose reader presses Ctrl-C at a fraction of the job."""

    @contextlib.contextmanager
    def bar(what: str, *, quiet: bool = False) -> Iterator[Progress]:
        def report(fraction: float, what: str = "") -> None:
            if fraction >= at:
                raise KeyboardInterrupt

        yield report

    return bar


@pytest.mark.by_turn
@pytest.mark.parametrize("fraction", [0.0, 0.05, 0.4, 0.7, 1.0])
def test_compensate(folder: Path, refused: Any, monkeypatch: pytest.MonkeyPatch, fraction: float) -> None:
    monkeypatch.setattr("counterflex.cli.commands.program.progress_bar", _stops_at(fraction))
    assert refused("compensate", "part.ngc", "--cell", "cell.toml", "--out", "new/out", status=130) == SAID


@pytest.mark.by_turn
@pytest.mark.parametrize("fraction", [0.0, 0.15, 0.85, 1.0])
def test_prove(folder: Path, refused: Any, monkeypatch: pytest.MonkeyPatch, fraction: float) -> None:
    monkeypatch.setattr("counterflex.cli.commands.prove.progress_bar", _stops_at(fraction))
    assert refused("prove", "part.ngc", "--cell", "cell.toml", "--out", "new/out", "--workers", "1", status=130) == SAID


def test_demo(refused: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("counterflex.cli.commands.prove.progress_bar", _stops_at(0.0))
    assert refused("demo", "--out", "new/out", status=130) == SAID


def test_results_of_an_earlier_run_stay(folder: Path, refused: Any, counterflex: Any, monkeypatch: Any) -> None:
    command = ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--no-report")
    assert counterflex(*command).status == 0
    monkeypatch.setattr("counterflex.cli.commands.program.progress_bar", _stops_at(1.0))
    refused(*command, status=130)


def test_failure_while_files_are_moved_puts_everything_back(folder: Path, refused: Any, counterflex: Any) -> None:
    command = ("compensate", "part.ngc", "--cell", "cell.toml", "--out", "out", "--no-report")
    assert counterflex(*command).status == 0
    (folder / "out" / "summary.json").unlink()
    (folder / "out" / "summary.json").mkdir()  # the last file to be moved cannot take its place
    (folder / "out" / "summary.json" / "kept").touch()
    assert "out: cannot write" in refused(*command)


# The signal itself, from inside: when the job reports a fraction, the whole process group gets it, as from a terminal.
PRESS = """
import contextlib, os, signal, sys
from counterflex.cli import start
from counterflex.cli.commands import program, prove

@contextlib.contextmanager
def bar(what, *, quiet=False):
    def report(done, what=""):
        if done >= float(os.environ["AT"]):
            os.killpg(0, getattr(signal, os.environ["SIGNAL"]))
    yield report

program.progress_bar = prove.progress_bar = bar
if __name__ == "__main__":
    start.run()
"""


if sys.platform != "win32":  # where a terminal's Ctrl-C is a signal to a process group

    @pytest.mark.by_turn
    @pytest.mark.parametrize(
        ("words", "at", "number"),
        [
            ("compensate part.ngc --cell cell.toml --out new/out", "0.2", "SIGINT"),
            ("compensate part.ngc --cell cell.toml --out new/out", "0.2", "SIGTERM"),
            ("prove part.ngc --cell cell.toml --out new/out --workers 2 --no-exact", "0.2", "SIGINT"),
            ("demo --out new/out", "0.0", "SIGINT"),
        ],
        ids=["compensate", "request to terminate", "prove with workers", "demo"],
    )
    def test_real_signal(folder: Path, words: str, at: str, number: str) -> None:
        script = folder / "press.py"
        script.write_text(PRESS, encoding="utf-8")
        before = sorted(folder.rglob("*"))
        started = subprocess.Popen(
            [sys.executable, "-B", str(script), *words.split()],
            cwd=folder,
            env={**os.environ, "AT": at, "SIGNAL": number, "TMPDIR": str(folder / "temporary")},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        # The streams end when the last process that holds them does, so no worker is left either.
        out, err = started.communicate(timeout=300)
        assert (started.returncode, out, err) == ({"SIGINT": 130, "SIGTERM": 143}[number], "", SAID)
        assert sorted(folder.rglob("*")) == before
