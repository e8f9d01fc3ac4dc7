"""``rsi tune``: gains that a cell file takes back, and gains without a margin refused before a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.app.axis_controller import require_margins, shown, tune, write
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.files.cell.cell import Cell, read_cell

CELLS = Path(__file__).resolve().parents[2] / "examples" / "cells"
TEXT = (CELLS / "kr300_d16_small.toml").read_text(encoding="utf-8")
ONLINE = '\n[online]\nforce = "measured"\noutput = "axes"\n'


def cell_with(folder: Path, more: str) -> Cell:
    file = folder / "cell.toml"
    file.write_text(TEXT + more, encoding="utf-8")
    return read_cell(file)


def test_gains_come_back_from_the_cell_file_and_have_their_margins(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, "# kept\n" + ONLINE)
    found = tune(cell)
    assert all(row["phase_margin_deg"] >= 50.0 and row["gain_margin_db"] >= 10.0 for row in shown(found))
    assert all(row["largest_pole"] < 1.0 and row["error_after_step_ms"] < row["error_alone_ms"] for row in shown(found))
    assert shown(found)[0]["mode_hz"] < shown(found)[5]["mode_hz"]  # the base swings slower than the hand
    write(cell, found, tmp_path / "tuned.toml")
    assert "# kept" in (tmp_path / "tuned.toml").read_text(encoding="utf-8")
    tuned = read_cell(tmp_path / "tuned.toml")
    table = tuned.tables.online
    assert table is not None
    settings = table.settings(None, compensated=False)
    assert settings.axis_pid is not None
    for gains, one in zip(settings.axis_pid, found, strict=True):
        assert one.design is not None
        assert gains.proportional == pytest.approx(one.design.gains.proportional, rel=1e-3)
    require_margins(tuned, settings)


def test_gains_without_a_margin_are_refused(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, ONLINE + "\n[online.axis_pid]\nproportional = [0, 6, 0, 0, 0, 0]\n")
    table = cell.tables.online
    assert table is not None
    with pytest.raises(InputError, match="axis 2.*rsi tune"):
        require_margins(cell, table.settings(None, compensated=False))


def test_a_cell_without_online_correction_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"no table \[online\]"):
        tune(cell_with(tmp_path, ""))


def test_what_does_not_go_with_it_is_not_written(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, '\n[online]\ntracker = "observer"\n')
    with pytest.raises(InputError, match="does not go with this"):
        write(cell, (), tmp_path / "tuned.toml")
    assert not (tmp_path / "tuned.toml").exists()


def test_margins_that_nothing_keeps_are_refused(tmp_path: Path) -> None:
    slow = ONLINE + "dead_ms = 24\nnatural_hz = 20\nphase_margin_deg = 80\ngain_margin_db = 30\n"
    with pytest.raises(ModelError, match="no axis has a gain"):
        tune(cell_with(tmp_path, slow))
