"""Steps of long jobs are as old as the program that made them: its files count, what only shows does not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from counterflex.app.long_jobs import step_cache
from counterflex.app.long_jobs.step_cache import program_files

FILES = {"__init__.py": "", "robot/arm.py": "L = 1.0\n", "robot/data/kr.toml": "length_m = 2.0\n", "report/page.py": ""}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(step_cache, "_ROOT", tmp_path)
    program_files.cache_clear()
    yield tmp_path
    program_files.cache_clear()


def now(package: Path, name: str, text: str) -> dict[str, str]:
    (package / name).parent.mkdir(exist_ok=True)
    (package / name).write_text(text, encoding="utf-8")
    program_files.cache_clear()
    return dict(program_files())


@pytest.mark.parametrize("name", ["robot/arm.py", "robot/data/kr.toml", "robot/__main__.py"])
def test_any_file_that_computes_counts_and_names_its_room(package: Path, name: str) -> None:
    before = dict(program_files())
    after = now(package, name, "L = 1.5\n")
    assert {room for room in after if after[room] != before[room]} == {"code of robot"}


@pytest.mark.parametrize("name", ["report/page.py", "cli/main.py", "__pycache__/arm.pyc"])
def test_what_only_shows_does_not_count(package: Path, name: str) -> None:
    before = dict(program_files())
    assert set(before) == {"code", "code of robot"}
    assert now(package, name, "X = 2\n") == before


def test_the_rooms_of_this_program_are_there() -> None:
    assert {"code of identify", "code of plan", "code of twin", "code of cutting"} <= set(dict(program_files()))
