"""New cell files and histories that two processes write at once: neither replaces what the other has written."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.app.production.history import RUNS, require_unchanged
from counterflex.core.errors import InputError, OutputError
from counterflex.files.cell.update import new_cell, new_file


def test_a_cell_file_that_another_process_has_written_meanwhile_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "new.toml"
    with pytest.raises(InputError, match="another process has written this file meanwhile"), new_cell(target) as place:
        place.write_text("mine")
        target.write_text("the other's")
    assert target.read_text() == "the other's"
    assert list(tmp_path.iterdir()) == [target]


def test_a_cell_file_appears_when_its_block_ends_well(tmp_path: Path) -> None:
    with new_file(None) as place:
        assert place is None
    with new_file(tmp_path / "new.toml") as place:
        assert place is not None
        place.write_text("mine")
        assert not (tmp_path / "new.toml").exists()
    assert (tmp_path / "new.toml").read_text() == "mine"
    with pytest.raises(ZeroDivisionError), new_file(tmp_path / "other.toml"):
        raise ZeroDivisionError
    assert not (tmp_path / "other.toml").exists()


def test_a_history_that_has_grown_meanwhile_is_not_written_over(tmp_path: Path) -> None:
    for number in (1, 2):
        (tmp_path / RUNS / f"{number:03d}").mkdir(parents=True)
    require_unchanged(tmp_path, 2)
    with pytest.raises(OutputError, match="another process has written the history meanwhile") as fault:
        require_unchanged(tmp_path, 1)
    assert "2 runs" in str(fault.value)
    require_unchanged(tmp_path / "none", 0)
