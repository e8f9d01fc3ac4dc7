"""The command in a shell: as a module, in groups, and completed by the shell."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import typer

from counterflex.cli.main import PANELS, whole

ROOT = Path(__file__).resolve().parents[2]


def module(*words: str, **more: str) -> subprocess.CompletedProcess[str]:
    """``python -m counterflex`` with words, and variables of the environment besides."""
    return subprocess.run(
        [sys.executable, "-m", "counterflex", *words],
        capture_output=True, text=True, env={**os.environ, **more}, check=False, timeout=60,
    )  # fmt: skip


def test_python_m_counterflex_is_the_command() -> None:
    assert module("--version").stdout.startswith("counterflex ")
    missing = module("path", "none.ngc")
    assert missing.returncode == 2
    assert missing.stderr.startswith("error: ")
    assert missing.stderr.count("\n") == 1


def test_the_shell_completes_commands_and_options() -> None:
    found = module(_COUNTERFLEX_COMPLETE="complete_bash", COMP_WORDS="counterflex comp", COMP_CWORD="1")
    assert found.stdout.split() == ["compensate"]
    found = module(_COUNTERFLEX_COMPLETE="complete_bash", COMP_WORDS="counterflex compensate --scen", COMP_CWORD="2")
    assert found.stdout.split() == ["--scenario"]
    asked = f"{sys.executable} -m counterflex --show-completion; true"  # it looks which shell has called it
    found = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, check=True, timeout=60)
    assert "_COUNTERFLEX_COMPLETE=complete_bash" in found.stdout


def test_every_command_has_its_heading(counterflex: Any) -> None:
    """In the order of the work: plan, prove, identify, online, devices, tools."""
    named = [name for names in PANELS.values() for name in names]
    assert len(named) == len(set(named))
    group = typer.main.get_command(whole())
    assert set(named) == set(group.commands)  # type: ignore[attr-defined]
    said = counterflex("--help").out
    places = [said.index(f"\n{panel}:\n") for panel in PANELS]
    assert places == sorted(places)
    for number, (panel, names) in enumerate(PANELS.items()):
        part = said[places[number] : (places[number + 1] if number + 1 < len(places) else None)]
        for name in names:
            assert f" {name} " in part, (panel, name)


def test_after_make_demo_the_line_that_activates_is_printed() -> None:
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").split("\ndemo:")[1].split("\n\n")[0]
    assert recipe.rstrip().splitlines()[-1] == '\t@echo "To use the command in this terminal: source $(BIN)/activate"'
