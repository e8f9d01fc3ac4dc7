"""A finished step is known again by what it was made from, and by nothing else; what changed is named."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from counterflex.app.long_jobs.step_cache import (
    DONE,
    Mark,
    begin,
    fingerprint,
    finish,
    finished,
    made_again,
    marks_below,
    why_again,
)
from counterflex.core.errors import FileFormatError

A: Mark = (("version", "1"), ("cell.toml [part]", "x"))
B: Mark = (("version", "1"), ("cell.toml [part]", "y"))


def written(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def test_content_counts_and_place_does_not(tmp_path: Path) -> None:
    a, b = (written(tmp_path / folder, "part.ngc", "x") for folder in ("one", "two"))
    c = written(tmp_path / "three", "part.ngc", "y")
    assert fingerprint(a, count=3) == fingerprint(b, count=3)
    marks = {fingerprint(a, count=3), fingerprint(c, count=3), fingerprint(a, count=4), fingerprint(a, a, count=3)}
    assert len(marks) == 4
    assert fingerprint(a, c) != fingerprint(c, a)
    with pytest.raises(FileFormatError):
        fingerprint(tmp_path / "none")


def test_a_cell_file_counts_by_its_meaning(tmp_path: Path) -> None:
    first = written(
        tmp_path / "1", "cell.toml", 'name = "a"\n[part]\nx_mm = 1.0\ny_mm = 2.0\n[online]\nlead_ms = 4.0\n'
    )
    same = written(
        tmp_path / "2",
        "cell.toml",
        '# again\nname = "a"\n[online]\nlead_ms = 4.0\n\n[part]\ny_mm = 2.0  # moved\nx_mm = 1.0\n',
    )
    other = written(
        tmp_path / "3", "cell.toml", 'name = "a"\n[part]\nx_mm = 1.5\ny_mm = 2.0\n[online]\nlead_ms = 4.0\n'
    )
    assert fingerprint(first) == fingerprint(same) != fingerprint(other)
    finish(tmp_path, fingerprint(first), {})
    assert why_again(tmp_path, fingerprint(other)) == "changed: cell.toml [part]"
    with pytest.raises(FileFormatError, match="TOML"):
        fingerprint(written(tmp_path / "4", "cell.toml", "= 3"))


def test_a_step_is_done_when_it_ended_and_its_inputs_are_the_same(tmp_path: Path) -> None:
    folder = tmp_path / "step"
    assert finished(folder, A) is None
    begin(folder)
    assert finished(folder, A) is None
    finish(folder, A, {"value": 1.5, "rows": [1, 2]})
    assert finished(folder, A) == {"value": 1.5, "rows": [1, 2]}
    assert finished(folder, B) is None
    begin(folder)
    assert finished(folder, A) is None


def test_what_changed_is_named_and_counted(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        begin(tmp_path / name, A)
        finish(tmp_path / name, A, {})
    before = marks_below(tmp_path)
    assert made_again(tmp_path, {}) == {}
    for name in ("a", "b"):
        assert why_again(tmp_path / name, B) == "changed: cell.toml [part]"
        begin(tmp_path / name, B)
    assert finished(tmp_path / "a", B) is None
    begin(tmp_path / "a", B)  # interrupted and taken up again: still for the same reason
    finish(tmp_path / "a", B, {})
    finish(tmp_path / "b", B, {})
    assert made_again(tmp_path, before) == {"changed: cell.toml [part]": 2}
    os.utime(tmp_path / "a" / DONE, (4e9, 4e9))  # by a computer whose clock is ahead
    assert made_again(tmp_path, marks_below(tmp_path)) == {}
    assert why_again(tmp_path / "a", B) == why_again(tmp_path / "new", B) == ""
    many: Mark = tuple((f"code of {k}", "1") for k in range(6))
    assert why_again(tmp_path / "a", many).endswith("and 4 more")


def test_a_damaged_or_older_mark_is_no_mark(tmp_path: Path) -> None:
    for text in ("", "{", "[]", '{"made_from": [["version", "1"], ["cell.toml [part]", "x"]]}', '{"made_from": [1]}'):
        (tmp_path / DONE).write_text(text, encoding="ascii")
        assert finished(tmp_path, A) is None
    (tmp_path / DONE).write_text('{"fingerprint": "f00", "found": {}}', encoding="ascii")
    assert finished(tmp_path, A) is None
    assert "did not note" in why_again(tmp_path, A)
