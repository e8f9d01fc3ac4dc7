"""The example cell with another robot of the catalogue: it is read, only the robot is another one, all or nothing."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from counterflex.app import examples
from counterflex.core.errors import InputError
from counterflex.files.cell.cell import read_cell


@pytest.mark.parametrize("robot", ["kuka_kr270_2", "kuka_kr500_r2830", "abb_irb6640_185_280"])
def test_only_the_robot_is_another_one(tmp_path: Path, robot: str) -> None:
    examples.write_all(tmp_path / "own.toml", robot)
    examples.write_all(tmp_path / "shipped" / "own.toml")
    for name in ("own.toml", "own-small.toml"):
        own = tomllib.loads((tmp_path / name).read_text(encoding="utf-8"))
        shipped = tomllib.loads((tmp_path / "shipped" / name).read_text(encoding="utf-8"))
        assert own.pop("robot") == {"catalog": robot}
        assert shipped.pop("robot") == {"catalog": examples.ROBOT}
        assert own.pop("name") != shipped.pop("name")
        if "kuka" not in robot:
            assert shipped["controller"].pop("rsi_version") == "4.1"
            assert "cycle_ms = 12  # of a KUKA" in (tmp_path / name).read_text(encoding="utf-8")
        assert own == shipped
        assert read_cell(tmp_path / name).tables.robot.catalog == robot


def test_a_robot_that_is_not_in_the_catalogue_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no robot 'kuka_kr2700'"):
        examples.write_all(tmp_path / "cell.toml", "kuka_kr2700")
    assert list(tmp_path.iterdir()) == []


def test_the_list_of_robots_loads_neither_planner_nor_compiler() -> None:
    script = "import sys, counterflex.app.robot_list as r; r.robots(); print([m for m in sys.modules])"
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = set(ast.literal_eval(ended.stdout))
    assert "counterflex.robot.model.catalog" in loaded
    assert not loaded & {"numba", "scipy", "polars", "counterflex.plan", "counterflex.files.cell.cell"}
