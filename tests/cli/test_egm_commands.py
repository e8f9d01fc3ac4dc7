"""The commands egm check and egm make, and what run and twin say when the protocol is not clear."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from counterflex.cli.main import app
from counterflex.integrations.abb.link.calls import read_egm_calls

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
EXTERNAL = "[9E9,9E9,9E9,9E9,9E9,9E9]"
POINTS = "".join(
    f"    MoveL [[{x},0,34],[0,0,1,0],[0,0,0,0],{EXTERNAL}],v25,{zone},t_p\\WObj:=w_p;\n"
    for x, zone in ((0, "fine"), (10, "z0"), (30, "z0"))
)
MODULE = (
    "MODULE p_m\n  PROC p()\n"
    f"    MoveAbsJ [[0,0,0,0,30,0],{EXTERNAL}],v100,fine,t_p\\WObj:=w_p;\n{POINTS}  ENDPROC\nENDMODULE\n"
)


def told(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(word) for word in arguments])
    text = result.output + (str(result.exception) if result.exception else "")
    return result.exit_code, text


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    out = tmp_path / "cell.toml"
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    out.write_text(text + '\n[online]\nforce = "measured"\nperiod_ms = 24\n', encoding="utf-8")
    return out


def test_make_writes_a_program_that_check_passes(tmp_path: Path, cell: Path) -> None:
    (tmp_path / "p.mod").write_text(MODULE, encoding="ascii")
    code, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "p.mod", "--out", tmp_path / "robot")
    assert code == 0, said
    assert "not tried on a controller" in said
    files = {path.name for path in (tmp_path / "robot").iterdir()}
    assert files == {"p.mod", "README.txt", "summary.json"}
    summary = json.loads((tmp_path / "robot" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["mode"], summary["sample_ms"], summary["timeout_ms"]) == ("path", 24, 100)
    assert [line for line in summary["warnings"] if "controller.correction_signal" not in line] == []
    assert "no output shows a safety PLC" in said
    text = cell.read_text(encoding="utf-8").replace("[controller]", '[controller]\ncorrection_signal = "doCorrection"')
    cell.write_text(text, encoding="utf-8")
    _, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "p.mod", "--out", tmp_path / "robot")
    assert "safety PLC" not in said
    readme = (tmp_path / "robot" / "README.txt").read_text(encoding="utf-8")
    assert max(map(len, readme.splitlines())) <= 120
    for word in ("UCdevice", "pathCorr", "Level               Path", "6510", "NOT TRIED ON A CONTROLLER"):
        assert word in readme
    code, said = told("egm", "check", tmp_path / "robot" / "p.mod", "--cell", cell)
    assert (code, said.strip()) == (0, "0 errors, 0 warnings")
    (setup,) = read_egm_calls(tmp_path / "robot" / "p.mod").of("EGMSETUPUC")
    assert setup.number("commtimeout") == 0.1


@pytest.mark.parametrize("host", ["mill-pc", "192.168.1", "10.0.0.1\n; run as you like", ""])
def test_a_host_that_is_no_address_is_refused(tmp_path: Path, cell: Path, host: str) -> None:
    """It is written into the README as what the controller has to be told."""
    (tmp_path / "p.mod").write_text(MODULE, encoding="ascii")
    words = ("egm", "make", "--cell", cell, "--program", tmp_path / "p.mod", "--out", tmp_path / "r", "--host", host)
    code, said = told(*words)
    assert (code, "not an IPv4 address" in said, (tmp_path / "r").exists()) == (1, True, False)


def test_make_for_guidance(tmp_path: Path, cell: Path) -> None:
    text = cell.read_text(encoding="utf-8").replace("period_ms = 24", "period_ms = 4")
    cell.write_text(text + '\n[egm]\nmode = "pose"\ntimeout_ms = 40\nspeed_reference = true\n', encoding="utf-8")
    (tmp_path / "p.mod").write_text(MODULE, encoding="ascii")
    code, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "p.mod", "--out", tmp_path / "r", "--json")
    assert code == 0, said
    assert json.loads(said)["mode"] == "pose"
    assert "continues with the last one until its CommTimeout" in (tmp_path / "r" / "README.txt").read_text(
        encoding="utf-8"
    )
    code, said = told("egm", "check", tmp_path / "r" / "p.mod", "--cell", cell, "--json")
    assert json.loads(said)["errors"] == 0


def test_the_dangerous_example_ends_with_one(cell: Path) -> None:
    code, said = told("egm", "check", EXAMPLES / "egm" / "dangerous.mod")
    assert code == 1
    for rule in ("timeout", "fine", "handler", "speed-deviation", "axes", "no-wait", "velocity", "stop"):
        assert f"error [{rule}]" in said
    assert "not checked without --cell" in said
    _, beside = told("egm", "check", EXAMPLES / "egm" / "dangerous.mod", "--cell", cell)
    assert "the cell file says otherwise" in beside


def test_bad_input_is_one_clear_line(tmp_path: Path, cell: Path) -> None:
    (tmp_path / "p.src").write_text("DEF p( )\nEND\n", encoding="ascii")
    out = tmp_path / "robot"
    _, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "p.src", "--out", out)
    assert "not a RAPID module" in said
    _, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "missing.mod", "--out", out)
    assert "no such file" in said
    (tmp_path / "main.mod").write_text(MODULE.replace(POINTS, "    p_001;\n"), encoding="ascii")
    _, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "main.mod", "--out", out)
    assert "does not lie beside it" in said
    assert not out.exists()
    text = cell.read_text(encoding="utf-8")
    cell.write_text(text + "\n[egm]\ntimeout_ms = 1000\n", encoding="utf-8")
    _, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "main.mod", "--out", out)
    assert "timeout_ms" in said
    assert "100" in said


def test_the_compensated_program_is_not_written_over(tmp_path: Path, cell: Path) -> None:
    (tmp_path / "p.mod").write_text(MODULE, encoding="ascii")
    before = (tmp_path / "p.mod").read_bytes()
    code, said = told("egm", "make", "--cell", cell, "--program", tmp_path / "p.mod", "--out", tmp_path)
    assert code != 0
    assert "could be replaced" in said
    assert (tmp_path / "p.mod").read_bytes() == before


def test_run_and_twin_need_one_protocol(tmp_path: Path, cell: Path) -> None:
    _, said = told("run", "--cell", cell, "--out", tmp_path / "log")
    assert "--egm for an ABB robot or --rsi FILE for a KUKA robot" in said
