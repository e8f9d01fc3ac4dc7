"""The first predicted length that a command prints is the one to plan with, or is named as the model's alone."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Final

import pytest

import counterflex.cli
from counterflex.cli.main import parsed
from counterflex.report.glossary import EXPECTED_UM, MODEL, MODEL_UM

CELL: Final = Path(__file__).parents[1] / "data" / "cells" / "small.toml"
PROGRAM: Final = "G21 G90 G17\nT1 M6\nM3 S13000\nG0 X-12 Y15 Z45\nG1 Z36 F3000\nG1 X72 F1500\nG0 Z45\nM2\n"
_BARE: Final = re.compile(r"(?:predicted |by the model |largest )?(?:error|deflection) um|by the model um")


def test_no_column_gives_a_predicted_length_without_saying_whose() -> None:
    """Of every text in the commands: the model's own figures have one name, see ``cli/output.py``."""
    found = [
        f"{file.name}:{node.lineno} {node.value}"
        for file in Path(counterflex.cli.__path__[0]).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and _BARE.fullmatch(node.value)
    ]
    assert found == []


def strategy(capsys: pytest.CaptureFixture[str], *more: str) -> str:
    words = ["--ae-mm", "0.5:4", "--ap-mm", "5", "--fz-mm", "0.02:0.06", "--rpm", "13000"]
    parsed(["plan", "strategy", "--cell", str(CELL), *words, *more])
    return capsys.readouterr().out


def test_strategy_begins_with_the_median_and_its_range(capsys: pytest.CaptureFixture[str]) -> None:
    answer = json.loads(strategy(capsys, "--json"))
    printed = strategy(capsys)
    flat = " ".join(printed.split())
    assert "model is without their unknowns" in flat
    head = next(line for line in printed.splitlines() if "milling" in line)
    assert head.index("expected") < head.index("up to") < head.index("model")
    assert answer["choices"]
    for row in answer["choices"]:
        median, low, high = row["expected_um"]
        assert 0.0 <= low < median < high
        assert low <= abs(row["error_um"]) <= high
        assert median <= row["up_to_um"] <= high


@pytest.mark.parametrize("command", [["plan", "entry"], ["plan", "map", "--points", "4"]])
def test_what_draws_nothing_says_so(command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = tmp_path / "part.ngc"
    program.write_text(PROGRAM, encoding="utf-8")
    where = ["--cell", str(CELL), "--out", str(tmp_path / "out")]
    parsed([*command[:2], str(program), *where, *command[2:]])
    flat = " ".join(capsys.readouterr().out.split()).lower()
    assert MODEL in flat
    assert "cell check says what each can cost" in flat


def test_names_are_those_of_one_place() -> None:
    assert EXPECTED_UM == "expected um"
    assert MODEL_UM.startswith(MODEL)
