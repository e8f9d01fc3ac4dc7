"""Cell files of a campaign: with their own files beside them, and with the place and posture of another one."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.set_up import text_placed_as, text_with_files, text_with_part, text_with_posture


def test_an_identified_cell_gets_place_and_posture_of_the_set_up(small: Path, tmp_path: Path) -> None:
    identified, setup = tmp_path / "identified.toml", tmp_path / "setup.toml"
    text = small.read_text(encoding="utf-8")
    identified.write_text(text.replace("kc11_n_mm2 = 780", "kc11_n_mm2 = 900"), encoding="utf-8")
    setup.write_text(text_with_part(small, {"x_mm": 1234.5, "c_deg": 5.0}, tmp_path), encoding="utf-8")
    setup.write_text(text_with_posture(setup, "front up flip", 33.0, tmp_path), encoding="utf-8")
    placed = tmp_path / "placed.toml"
    placed.write_text(text_placed_as(identified, setup, tmp_path), encoding="utf-8")
    cell, there = read_cell(placed), read_cell(setup)
    assert cell.T_base_part == pytest.approx(there.T_base_part)
    assert cell.T_base_part[0, 3] == pytest.approx(1.2345)
    assert cell.tables.posture == there.tables.posture
    assert cell.tables.posture.branch == "front up flip"
    assert cell.force_law == read_cell(identified).force_law != there.force_law


def test_a_cell_takes_its_blank_along(small: Path, tmp_path: Path) -> None:
    (tmp_path / "shop").mkdir()
    (tmp_path / "shop" / "blank.stl").write_bytes(b"solid")
    cell = tmp_path / "shop" / "cell.toml"
    lines = small.read_text(encoding="utf-8").replace("[part.stock]", '[part.stock]\nstl = "blank.stl"')
    cell.write_text(lines, encoding="utf-8")
    out = tmp_path / "out"
    text, files = text_with_files(cell, out, out / "inputs")
    assert files == {out / "inputs" / "part-stock-stl.stl": b"solid"}
    assert 'stl = "inputs/part-stock-stl.stl"' in text
    (tmp_path / "shop" / "blank.stl").unlink()
    with pytest.raises(FileFormatError, match=r"blank\.stl"):
        text_with_files(cell, out, out / "inputs")
