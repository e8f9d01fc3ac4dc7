"""The digest of what jobs write: a changed number is found wherever it stands, a changed word is told from one."""

from __future__ import annotations

import importlib.util
import json
import sys
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st


def load() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "tools" / "digest.py"
    spec = importlib.util.spec_from_file_location("digest_tool", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["digest_tool"] = module
    spec.loader.exec_module(module)
    return module


DIGEST = load()
MASKS = [
    DIGEST.Mask("*.txt", pattern=r"\(\d+\.\d s\)"),
    DIGEST.Mask("log.csv", columns=("received_ns",)),
]


def folder(at: Path, files: dict[str, str]) -> Path:
    at.mkdir()
    for name, text in files.items():
        (at / name).write_text(text)
    entries = {name: asdict(DIGEST.digest(DIGEST.read(at / name, MASKS))) for name in files}
    (at / "digest.json").write_text(json.dumps(entries))
    return at


def test_a_changed_number_is_named_with_its_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = folder(tmp_path / "old", {"part.ngc": "N10 G1 X1.5 Y-2.25E1 F600\n", "same.json": '{"x_mm": 1}'})
    new = folder(tmp_path / "new", {"part.ngc": "N10 G1 X1.5 Y-2.26E1 F600\n", "same.json": '{"x_mm": 1}'})
    assert DIGEST.compare(old, new) == 1
    said = capsys.readouterr().out
    assert "part.ngc: 1 of 5 differ, most 0.1 " in said
    assert "1 differ in numbers, 0 in words only" in said
    assert "same.json" not in said


def test_a_changed_word_is_no_changed_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = folder(tmp_path / "old", {"a.json": '{"told": 0.25}'})
    new = folder(tmp_path / "new", {"a.json": '{"exact": 0.25}'})
    assert DIGEST.compare(old, new) == 0
    assert "a.json: words differ, numbers do not" in capsys.readouterr().out


def test_missing_files_and_numbers_are_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = folder(tmp_path / "old", {"a.txt": "1 2 3", "b.txt": "1"})
    new = folder(tmp_path / "new", {"a.txt": "1 2"})
    assert DIGEST.compare(old, new) == 1
    said = capsys.readouterr().out
    assert "a.txt: 3 numbers before, 2 after" in said
    assert "b.txt: only before" in said


def test_what_is_masked_may_vary_and_nothing_else(tmp_path: Path) -> None:
    first = {"said.txt": "wrote 3 files (0.7 s)", "log.csv": "x,received_ns,y\n1,5,2\n3,6,4\n"}
    later = {"said.txt": "wrote 3 files (1.2 s)", "log.csv": "x,received_ns,y\n1,7,2\n3,8,4\n"}
    other = {"said.txt": "wrote 4 files (0.7 s)", "log.csv": "x,received_ns,y\n1,5,2\n3,6,5\n"}
    old = folder(tmp_path / "first", first)
    assert DIGEST.compare(old, folder(tmp_path / "later", later)) == 0
    assert DIGEST.compare(old, folder(tmp_path / "other", other)) == 1


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20), st.data())
def test_one_unit_in_the_last_place_of_a_table_changes_its_digest(values: list[float], data: st.DataObject) -> None:
    k = data.draw(st.integers(0, len(values) - 1))
    changed = [*values]
    changed[k] = float(np.nextafter(values[k], np.inf))
    entries = []
    for column in (values, changed):
        content = DIGEST.Content(b"['x']", np.array(column))
        entries.append(DIGEST.digest(content))
    assert entries[0].values != entries[1].values
    assert entries[0].text == entries[1].text


def test_tables_give_their_columns_as_numbers(tmp_path: Path) -> None:
    pl.DataFrame({"x_mm": [1.0, 2.0], "name": ["a", "b"], "cut": [True, None]}).write_parquet(tmp_path / "t.parquet")
    content = DIGEST.read(tmp_path / "t.parquet", [])
    np.testing.assert_array_equal(content.numbers, [1.0, 2.0, 1.0, np.nan])
    assert b"x_mm" in content.text


def test_the_list_of_jobs_is_whole() -> None:
    jobs = DIGEST.tomllib.loads(DIGEST.JOBS.read_text())
    names = [job["name"] for job in jobs["job"]]
    assert len(set(names)) == len(names)
    for job in jobs["job"]:
        assert set(job) <= {"name", "steps", "quick", "sockets"}
        assert job["steps"]
    assert {f"identify-{recipe}" for recipe in ("stiffness", "kinematics", "cutting")} <= set(names)
    assert DIGEST.masks_of(jobs)
