"""Script for RoboDK: a program of the station goes through counterflex and comes back compensated, as a file.

Runs on RoboDK's Python with its package ``robodk`` and imports nothing of counterflex, which it starts as a program of
its own. RoboDK's post-processor writes the program in the robot's language, with tool and base; counterflex holds these
against the cell file. Written by the documentation of the interface and tried with a stand-in for RoboDK, not with
RoboDK itself.

Station parameters: ``COUNTERFLEX_CELL``, the cell file, asked for once; ``COUNTERFLEX_ARGUMENTS``, options of
``counterflex compensate``.
"""

from __future__ import annotations

import importlib
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

COUNTERFLEX = ["counterflex"]


def main() -> None:
    """Compensate the program that is picked and say where the result is."""
    robolink = importlib.import_module("robodk.robolink")
    station = robolink.Robolink()
    try:
        program = station.ItemUserPick("Program to compensate", robolink.ITEM_TYPE_PROGRAM)
        if not program.Valid():
            raise RuntimeError("counterflex: no program was chosen")
        station.ShowMessage(f"counterflex: compensated program and report in {_compensated(station, program)}", False)
    except RuntimeError as fault:
        station.ShowMessage(str(fault))
        sys.exit(str(fault))


def _compensated(station: Any, program: Any) -> Path:
    """Compensate a program and return the folder of the results."""
    cell, name = ["--cell", _cell(station)], program.Name()
    out = Path(station.getParam("PATH_OPENSTATION") or ".", name + "-counterflex")
    with tempfile.TemporaryDirectory() as made:
        done, log, _ = program.MakeProgram(made)
        if not done:
            raise RuntimeError(f"counterflex: RoboDK could not make the program '{name}':\n{log}")
        source = str(_main_file(Path(made), name))
        _run(["preflight", source, *cell], f"the program '{name}' does not pass the check before the cut")
        arguments = shlex.shlex(station.getParam("COUNTERFLEX_ARGUMENTS") or "", posix=True)
        arguments.whitespace_split, arguments.escape, arguments.commenters = True, "", ""  # a backslash parts folders
        _run(
            ["compensate", source, *cell, "--out", str(out), *arguments], f"the program '{name}' cannot be compensated"
        )
    return out


def _cell(station: Any) -> str:
    """Path of the cell file, which the station keeps."""
    cell = station.getParam("COUNTERFLEX_CELL")
    if not cell:
        dialogs = importlib.import_module("robodk.robodialogs")
        cell = dialogs.getOpenFileName(strtitle="Cell file of counterflex", defaultextension=".toml")
        if not cell:
            raise RuntimeError("counterflex: no cell file was chosen")
        station.setParam("COUNTERFLEX_CELL", cell)
    return str(cell)


def _main_file(folder: Path, name: str) -> Path:
    """File of the program among those that RoboDK made: the only one, or the one of its name that is no .dat."""
    files = sorted(folder.iterdir())
    same = [file for file in files if file.stem.lower() == name.lower() and file.suffix.lower() != ".dat"]
    candidates = files if len(files) == 1 else same
    if len(candidates) != 1:
        there = ", ".join(file.name for file in files) or "none was made"
        raise RuntimeError(f"counterflex: which of these files is the program '{name}'? {there}")
    return candidates[0]


def _run(words: list[str], what: str) -> None:
    """Run counterflex and print what it prints."""
    done = subprocess.run(
        [*COUNTERFLEX, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    print(done.stdout)
    if done.returncode != 0:
        raise RuntimeError(f"{what}:\n{done.stdout.strip()}")


if __name__ == "__main__":
    main()
