"""Programs that need a word of the user: read alike by every command that reads a program, and by what follows it."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pytest

from counterflex.cli.commands import program, prove, run as online

VAR = "5161\t0.0\n5162\t0.0\n5163\t90.0\n5220\t1\n5221\t0\n5222\t0\n5223\t0\n"


@pytest.mark.parametrize("command", [program.path, program.compensate, prove.simulate, prove.prove, online.cell])
def test_every_command_that_reads_a_program_takes_both(command: Any) -> None:
    assert {"parameters", "without_end"} <= set(inspect.signature(command).parameters)


def test_a_run_is_judged_by_the_program_as_it_was_read(folder: Path, machined: Any, counterflex: Any) -> None:
    """What a run needed to be read goes along with it."""
    home = (folder / "part.ngc").read_text(encoding="utf-8").replace("M2\n", "G91 G28 Z0\nG90\nG0 X0\n")
    (folder / "home.ngc").write_text(home, encoding="ascii")
    (folder / "machine.var").write_text(VAR, encoding="ascii")
    simulate = ("simulate", "home.ngc", "--cell", "cell.toml", "--truth", str(machined.folder / "truth.toml"))
    refused = counterflex(*simulate, "--out", "run")
    assert refused.status == 2
    ended = counterflex(*simulate, "--out", "run", "--parameters", "machine.var", "--without-end")
    assert ended.status == 0, ended.err
    judged = counterflex("evaluate", "run")
    assert judged.status == 0, judged.err


def test_compensate_names_every_file_that_it_writes(folder: Path, counterflex: Any) -> None:
    for more, page in (((), True), (("--no-report",), False)):
        words = ("compensate", "part.ngc", "--cell", "cell.toml", "--no-predict", "--out", f"out{page}", *more)
        ended = counterflex(*words)
        last = ended.out.strip().splitlines()[-1]
        assert all(path.name in last for path in (folder / f"out{page}").iterdir()), last
        assert ("report.html" in last) == page


@pytest.mark.long
def test_a_dwell_of_minutes_is_said_by_path_and_compensate(folder: Path, counterflex: Any) -> None:
    text = (folder / "part.ngc").read_text(encoding="utf-8").replace("M2\n", "G4 P500\nM2\n")
    (folder / "long.ngc").write_text(text, encoding="ascii")
    listed = counterflex("path", "long.ngc")
    assert (listed.status, "waits 500 s" in listed.err) == (0, True)
    written = counterflex(
        "compensate", "long.ngc", "--cell", "cell.toml", "--no-predict", "--no-report", "--out", "long"
    )
    assert "P500 in line" in written.out
    assert "write P0.5" in written.out
