"""The real command, run in this process, on a small cell and a short program."""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from command_parser import COMMANDS, command_of, commands_in, faults, options_of
from counterflex.app import examples
from counterflex.app.proof import simulate
from counterflex.app.proof.truth import make_truth
from counterflex.cli import start
from counterflex.files.cell.cell import read_cell
from made_once import made_once


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int
    out: str
    err: str


Command = Callable[..., Ended]

GROOVE = """G17 G54 G40 G49 G80 G90 G21
M6 T1
M3 S13000
G0 Z40
G0 X-12 Y15
G0 Z22
G1 Z17 F3000
G1 X10 F1500
G0 Z40
M2
"""


def small_cell() -> str:
    """The demonstration cell with a small, coarse blank (40 x 30 x 20 mm, 0.5 mm)."""
    text = examples.text("cell.toml")
    for old, new in (
        ("box_max_mm = [200, 150, 40]", "box_max_mm = [40, 30, 20]"),
        ("cell_mm = 0.1", "cell_mm = 0.5"),
        (
            "[[0, 0, 40], [200, 0, 40], [200, 150, 40], [0, 150, 40]]",
            "[[0, 0, 20], [40, 0, 20], [40, 30, 20], [0, 30, 20]]",
        ),
    ):
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with ``cell.toml`` and ``part.ngc``; temporary files of the program go below it too."""
    work = tmp_path / "work"
    (work / "temporary").mkdir(parents=True)
    monkeypatch.chdir(work)
    monkeypatch.setattr(tempfile, "tempdir", str(work / "temporary"))
    (work / "cell.toml").write_text(small_cell(), encoding="utf-8")
    (work / "part.ngc").write_text(GROOVE, encoding="utf-8")
    return work


@pytest.fixture
def counterflex(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """The command as the console script runs it."""

    def call(*arguments: str) -> Ended:
        monkeypatch.setattr(sys, "argv", ["counterflex", *arguments])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            start.run()
        said = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        if "--help" not in arguments:
            _check_suggestions(list(arguments), said.out + said.err)
        return Ended(ended.value.code, said.out, said.err)

    return call


def _check_suggestions(arguments: list[str], printed: str) -> None:
    """What a command prints can be typed: commands as they stand, options are those of the command that names them."""
    lines = [line for line in commands_in(printed) if len(line.split()) > 3 and "--help" not in line]
    wrong = [fault for line in lines for fault in faults(line)]
    command, _ = command_of(arguments)
    if command is not None and printed.startswith("error: "):
        hint = re.sub(r"`[^`]*`|as --[a-z]+ reads it", "", printed)
        for line in commands_in(printed):
            hint = hint.replace(line, "")
        others = [one for name, one in COMMANDS.commands.items() if re.search(rf"\b{name}\b", hint.lower())]
        known = options_of(command).union({"--version"}, *map(options_of, others))  # of a command that is named
        named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", hint)) - set(arguments)
        wrong += [f"{option} is no option of {command.name}" for option in sorted(named - known)]
    assert not wrong, "\n".join([*wrong, printed])


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every file and folder below a folder, hidden ones too, with what the files hold."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


Refused = Callable[..., str]


@pytest.fixture
def refused(folder: Path, counterflex: Command) -> Refused:
    """Run a command that must be refused: status 2, one line on standard error, nothing printed or left behind."""

    def call(*arguments: str, status: int = 2) -> str:
        before = contents(folder)
        ended = counterflex(*arguments)
        assert ended.status == status, ended.out + ended.err
        assert ended.out == ""
        assert ended.err.endswith("\n")
        assert ended.err.count("\n") == 1, ended.err
        assert ended.err.startswith("error: ")
        assert "Traceback" not in ended.err
        assert contents(folder) == before
        return ended.err

    return call


@dataclass(frozen=True)
class Machined:
    """A folder with a truth of each of two seeds and what was machined with them."""

    folder: Path


def _machine(folder: Path) -> None:
    (folder / "cell.toml").write_text(small_cell(), encoding="utf-8")
    (folder / "part.ngc").write_text(GROOVE, encoding="utf-8")
    cell = read_cell(folder / "cell.toml")
    for seed, truth, run in ((1, "truth.toml", "run"), (2, "truth-2.toml", "other-run")):
        make_truth(cell, seed, folder / truth)
        simulate.run(folder / "part.ngc", folder / "cell.toml", folder / truth, folder / run)


@pytest.fixture(scope="session")
def machined(tmp_path_factory: pytest.TempPathFactory) -> Machined:
    """``truth.toml``, ``run`` and ``other-run`` (another truth) of the small cell and the groove; read only."""
    return Machined(made_once(tmp_path_factory, "machined", _machine))
