"""A finished step is known again by what it was made from, and by nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.app.kept import DONE, begin, fingerprint, finish, finished
from counterflex.core.errors import FileFormatError


def test_content_counts_and_place_does_not(tmp_path: Path) -> None:
    a, b, c = (tmp_path / name for name in ("a", "b", "c"))
    a.write_text("x", encoding="ascii")
    b.write_text("x", encoding="ascii")
    c.write_text("y", encoding="ascii")
    assert fingerprint(a, count=3) == fingerprint(b, count=3)
    assert (
        len({fingerprint(a, count=3), fingerprint(c, count=3), fingerprint(a, count=4), fingerprint(a, a, count=3)})
        == 4
    )
    assert fingerprint(a, c) != fingerprint(c, a)
    with pytest.raises(FileFormatError):
        fingerprint(tmp_path / "none")


def test_a_step_is_done_when_it_ended_and_its_inputs_are_the_same(tmp_path: Path) -> None:
    folder = tmp_path / "step"
    assert finished(folder, "m") is None
    begin(folder)
    assert finished(folder, "m") is None
    finish(folder, "m", {"value": 1.5, "rows": [1, 2]})
    assert finished(folder, "m") == {"value": 1.5, "rows": [1, 2]}
    assert finished(folder, "other") is None
    begin(folder)
    assert finished(folder, "m") is None


def test_a_damaged_mark_is_no_mark(tmp_path: Path) -> None:
    for text in ("", "{", "[]", '{"fingerprint": "m"}'):
        (tmp_path / DONE).write_text(text, encoding="ascii")
        assert finished(tmp_path, "m") is None
