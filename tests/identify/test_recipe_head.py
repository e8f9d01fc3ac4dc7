"""The head that all recipes share: it refuses what no recipe can use, and completes the settings, once."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import counterflex
from counterflex.core.errors import InputError
from counterflex.identify.data.dataset import of_arrays
from counterflex.identify.data.model import CellModel
from counterflex.identify.recipe import Inputs, Recipe
from counterflex.identify.recipes import RECIPES

CELL = cast(CellModel, None)
FOLDER = Path(counterflex.__file__).parent / "identify"


def _dataset(kind: str) -> Any:
    return of_arrays("d", kind, {"q": np.zeros((3, 6))})


def _echo() -> tuple[Recipe, list[Inputs]]:
    got: list[Inputs] = []

    def find(inputs: Inputs) -> Any:
        got.append(inputs)

    return replace(RECIPES["timing"], settings={"lag": "auto", "pairs": "auto"}, find=find), got


def test_settings_are_complete_and_those_of_the_user_win() -> None:
    echo, got = _echo()
    echo.identify(CELL, [_dataset("record")], settings={"lag": "first"})
    assert got[0].settings == {"lag": "first", "pairs": "auto"}
    assert [d.kind for d in got[0].data] == ["record"]
    assert got[0].holdout == ()


def test_no_data_is_refused_and_so_is_another_kind_also_in_the_holdout() -> None:
    echo, got = _echo()
    with pytest.raises(InputError, match="needs at least one dataset"):
        echo.identify(CELL, [])
    with pytest.raises(InputError, match="'timing' does not use such data"):
        echo.identify(CELL, [_dataset("pulls")])
    with pytest.raises(InputError, match="'timing' does not use such data"):
        echo.identify(CELL, [_dataset("record")], [_dataset("pulls")])
    assert got == []


@pytest.mark.parametrize("name", RECIPES.own)
def test_a_recipe_has_no_head_of_its_own(name: str) -> None:
    tree = ast.parse((FOLDER / RECIPES.own[name].split(".")[2] / "recipe.py").read_text(encoding="utf-8"))
    heads = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == "identify"]
    assert [[a.arg for a in n.args.args] for n in heads] == [["inputs"]]
    assert RECIPES[name].name == name
