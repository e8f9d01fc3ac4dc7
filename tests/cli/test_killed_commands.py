"""Commands that write several files, killed before each of their renames: the former files or the new ones, never both.

They are commands of a second; all others write by the same mechanism (`tests/core/test_every_writer.py`).
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from counterflex.app import examples
from counterflex.cli import start
from counterflex.core.moving import JOURNAL, settle
from counterflex.core.output_place import SUFFIX
from killed_process import each_kill

JOBS: Final = {
    "convert": "convert part.ngc --cell cell.toml --to krl --out out",
    "convert in parts": "convert part.ngc --cell cell.toml --to rapid --points-per-file 10 --out out",
    "rsi make": "rsi make --cell cell.toml --host {host} --out out",
}


def _run(words: str) -> None:
    """Run a command in this process; what it prints is of no interest."""
    sys.argv = ["counterflex", *words.split()]
    with open(os.devnull, "w") as nothing:  # noqa: PTH123 - a device
        sys.stdout = sys.stderr = nothing
        try:
            start.run()
        except SystemExit as ended:
            if ended.code:
                raise


def _files(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder, without what a killed command left for the next one to clear."""
    names = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return {name.as_posix(): (folder / name).read_bytes() for name in names if not name.parts[0].endswith(SUFFIX)}


def _files_in_place(folder: Path) -> dict[str, bytes]:
    return {name: content for name, content in _files(folder).items() if not name.startswith(JOURNAL)}


def _run_of(job: str, turn: int) -> Callable[[], None]:
    """Return a run of a command; of every turn the program has another feed, and the computer another address."""
    steps = "\n".join(f"G1 X{x}.{turn} F15{turn:02d}" for x in range(16, 74, 2))
    program = examples.text("groove.ngc").replace("G1 X72 F1500", steps)
    Path("part.ngc").write_text(program, encoding="utf-8")
    return lambda: _run(JOBS[job].format(host=f"10.0.0.{turn}"))


@pytest.mark.long
@pytest.mark.parametrize("job", JOBS)
def test_killed_before_each_rename(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, job: str) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("argv", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, getattr(sys, name))
    cell = examples.text("cell.toml") + '\n[online]\nforce = "pilot"\nperiod_ms = 4\n'
    Path("cell.toml").write_text(cell, encoding="utf-8")
    out = tmp_path / "out"
    _run_of(job, 2)()
    new = _files(out)
    shutil.rmtree(out)
    _run_of(job, 1)()
    old, again = _files(out), _run_of(job, 2)
    assert set(old) == set(new)
    assert sum(old[name] != new[name] for name in old) > 0
    ends = set()
    for number in each_kill(again, ("replace",)):
        raw = _files_in_place(out)
        assert raw.items() <= old.items() or raw.items() <= new.items(), f"both, killed before rename {number}"
        settle(out)
        assert _files(out) in (old, new), number
        ends.add(_files(out) == new)
        shutil.rmtree(out)
        _run_of(job, 1)()
        again = _run_of(job, 2)
    assert ends == {False, True}
