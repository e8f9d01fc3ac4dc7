"""Every language of a robot holds the laws of ``counterflex extensions LANGUAGE``, and a fault in one is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app import language_trial
from counterflex.app.language_trial import trial
from counterflex.core.errors import InputError
from counterflex.programs.compensated import CompensatedPath
from counterflex.programs.language import LANGUAGES, object_at, robot_dialects

CELL = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cell of the examples with names of the tool frames."""
    text = CELL.read_text(encoding="utf-8")
    for number in (1, 2):
        names = f'number = {number}\ntool_data = {number}\ntooldata = "tMill{number}"\n'
        text = text.replace(f"number = {number}\n", names)
    file = tmp_path_factory.mktemp("shop") / "cell.toml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("dialect", [name for name in robot_dialects() if name in LANGUAGES.own])
def test_a_language_holds_every_law(cell: Path, dialect: str) -> None:
    assert [(law, fault) for law, fault in trial(dialect, cell) if fault] == []


def test_a_fault_of_a_language_is_named(cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rapid = LANGUAGES["rapid"]

    def without_turn(program: Any, path: CompensatedPath, **settings: Any) -> Any:
        unturned = replace(path, rotvec_part_command=np.zeros_like(path.rotvec_part_command))
        return object_at(rapid.in_place)(program, unturned, **settings)

    broken = replace(rapid, in_place=without_turn, signs=LANGUAGES["krl"].signs)
    monkeypatch.setattr(language_trial, "LANGUAGES", {"rapid": broken})
    faults = [fault for _, fault in trial("rapid", cell) if fault]
    assert len(faults) == 2
    assert faults[0] == "the text is taken for ABB RAPID"
    assert faults[1].endswith("and 538.5 urad")  # the length of the turn that was asked for


@pytest.mark.parametrize("dialect", ["linuxcnc", "sinumerik"])
def test_a_language_of_machines_is_refused(cell: Path, dialect: str) -> None:
    with pytest.raises(InputError, match="a language of robots with convert is tried"):
        trial(dialect, cell)
