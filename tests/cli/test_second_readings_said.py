"""Every command that reads a program says which of its words have a second reading."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
import typer

from counterflex.app import inputs
from counterflex.app.proof.truth import make_truth
from counterflex.cli.main import parsed, whole
from counterflex.files.cell.cell import read_cell

CELL: Final = Path(__file__).parents[1] / "data" / "cells" / "small.toml"
SILENT: Final = "G90 G17\nT1 M6\nG43 H1\nS13000 M3\nG0 X20 Y15 Z45\nG1 Z36 F1500\nG1 X40\nG0 Z45\nM5\nM30\n"
"""Says no unit."""
SAID: Final = "no line before it says the unit"
COMMANDS: Final = {
    "path": "PROGRAM",
    "compensate": "PROGRAM --cell CELL --out OUT",
    "convert": "PROGRAM --cell CELL --out OUT --to krl",
    "diff": "PROGRAM PROGRAM",
    "preflight": "PROGRAM --cell CELL",
    "simulate": "PROGRAM --cell CELL --truth TRUTH --out OUT",
    "prove": "PROGRAM --cell CELL --out OUT",
    "inspect": "PROGRAM --scan SCAN --cell CELL --out OUT",
    "firstcut": "PROGRAM --cell CELL --out OUT",
    "campaign": "PROGRAM --cell CELL --out OUT --seeds 1",
    "cell check": "CELL --program PROGRAM",
    "quote": "PART PROGRAM CELL --out OUT",
    "correct": "PROGRAM --cell CELL --plan PLAN --scan SCAN --out OUT",
    "twin track": "PROGRAM --cell CELL --truth TRUTH --out OUT",
    "twin cell": "PROGRAM --cell CELL --truth TRUTH --out OUT --egm 127.0.0.1:6510",
    "plan placement": "PROGRAM --cell CELL --out OUT",
    "plan map": "PROGRAM --cell CELL --out OUT",
    "plan posture": "PROGRAM --cell CELL --out OUT",
    "plan strategy": "PROGRAM --cell CELL",
    "plan trochoid": "PROGRAM --cell CELL --out OUT",
    "plan entry": "PROGRAM --cell CELL --out OUT",
    "plan stability": "PROGRAM --cell CELL",
}
"""Command lines; words in capitals are files."""
OTHERS: Final = {
    "report": "reads runs, whose programs were read when they were made",
    "run": "reads a plan", "log replay": "reads a log", "log export": "reads a log",
    "iso9283": "takes poses of a program", "iso230 circularity": "takes a path", "iso230 straightness": "takes a path",
    "twin rsi": "plays poses", "twin egm": "reads a module of the controller",
    "egm check": "reads a module of the controller", "egm make": "reads a module of the controller",
    "rsi make": "reads no program",
}  # fmt: skip
_FULL: Final = ("path", "diff", "convert")
"""Run to their end; all others end once they have read the program."""


def commands(group: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*words, name))
        else:
            yield " ".join((*words, name)), command


def test_every_command_with_a_program_is_walked_here() -> None:
    def reads(parameter: Any) -> bool:
        named = parameter.name in ("program", "original", "before", "programs")
        return named or "PROGRAM" in (getattr(parameter, "metavar", None) or "")

    found = {
        name
        for name, command in commands(typer.main.get_command(whole()))
        if any(reads(parameter) for parameter in command.params)
    }
    assert found == {*COMMANDS, *OTHERS}


def stop(*_: Any) -> None:
    raise typer.Exit


@pytest.mark.parametrize("command", COMMANDS)
def test_a_unit_that_is_not_said_is_named_once(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "silent.ngc"
    program.write_text(SILENT, encoding="utf-8")
    files = {"PROGRAM": program, "CELL": CELL, "OUT": tmp_path / "out", "TRUTH": tmp_path / "truth.toml"}
    if "TRUTH" in COMMANDS[command]:
        make_truth(read_cell(CELL), 1, files["TRUTH"])
    for word in ("SCAN", "PLAN"):
        files[word] = tmp_path / word.lower()
    files["SCAN"].write_text("0 0 40\n1 0 40\n0 1 40\n", encoding="utf-8")
    files["PART"] = tmp_path / "part.csv"
    files["PART"].write_text("feature,quantity,tolerance_mm\ngroove 1,width,0.1\n", encoding="utf-8")
    files["PLAN"].mkdir()
    if command not in _FULL:
        monkeypatch.setattr(inputs, "_in_plane_of", stop)
        monkeypatch.setattr(inputs, "_job", stop)
    words = [str(files.get(word, word)) for word in COMMANDS[command].split()]
    parsed([*command.split(), *words])
    printed = capsys.readouterr()
    assert (printed.out + printed.err).count(SAID) == 1


@pytest.mark.parametrize("command", ["compensate", "preflight"])
def test_what_the_command_shows_itself_is_not_said_again(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "silent.ngc"
    program.write_text(SILENT, encoding="utf-8")
    where = ["--out", str(tmp_path / "out")] if command == "compensate" else []
    parsed([command, str(program), "--cell", str(CELL), *where])
    printed = capsys.readouterr()
    assert (printed.out + printed.err).count(SAID) == 1
