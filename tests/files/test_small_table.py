"""Tables that people write: the same numbers whatever language the spreadsheet speaks, and the true cause else."""

from __future__ import annotations

from pathlib import Path

import pytest

from counterflex.app.controller_import.job import JOINTS, POSE, read_poses
from counterflex.core.errors import FileFormatError
from counterflex.files.commanded_file import read_commanded
from counterflex.files.small_table import read_rows, read_tolerances, rows_of

NUMBERS = [10.5, -90.25, 85.0, 0.125, 30.0, -1.5e-3, 1200.75, -30.0, 1000.5, 0.0, 90.0, 180.0]


def _poses(separator: str, comma: bool, ends: str = "\n") -> str:
    cells = [f"{value:g}".replace(".", "," if comma else ".") for value in NUMBERS]
    lines = ["# from the pendant", separator.join([*JOINTS, *POSE, "tool"]), separator.join([*cells, "spindle"]), ""]
    return ends.join(lines)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_poses_are_the_same_in_every_separator(separator: str, comma: bool, ends: str) -> None:
    text = _poses(separator, comma, ends)
    if separator == "," and comma:
        with pytest.raises(FileFormatError, match="more cells than the header.*decimal commas.*semicolons") as caught:
            read_poses(text, "poses.csv", "", "")
        assert caught.value.where == "poses.csv:3"
        return
    expected = read_poses(_poses(",", False), "poses.csv", "", "")
    got = read_poses(text, "poses.csv", "", "")
    assert [one.q.tolist() for one in got] == [one.q.tolist() for one in expected]
    assert [one.T_base_tool.tolist() for one in got] == [one.T_base_tool.tolist() for one in expected]
    assert got[0].tool == "spindle"
    assert got[0].line == 3


def test_other_tables_too(tmp_path: Path) -> None:
    file = tmp_path / "t.csv"
    file.write_text("feature;quantity;tolerance_mm\npocket;diameter;0,05\n", encoding="utf-8-sig")
    assert read_tolerances(file) == {("pocket", "diameter"): pytest.approx(0.05e-3)}
    file.write_text("x_mm;y_mm;z_mm\n1,5;2;-3,25\n", encoding="utf-8")
    assert read_commanded(file)[0][0, :3, 3] == pytest.approx([1.5e-3, 2e-3, -3.25e-3])


def test_what_is_not_clear_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"a\.csv:2: a number is grouped by points; got 1\.234,5"):
        rows_of("x;y\n1.234,5;2\n", "a.csv")
    assert rows_of("x;name\n1,5;a,b\n", "a.csv")[1][1] == ["1.5", "a,b"]
    (tmp_path / "book.csv").write_bytes(b"PK\x03\x04\xff\xfe")
    with pytest.raises(FileFormatError, match="spreadsheet workbook"):
        read_rows(tmp_path / "book.csv")
    with pytest.raises(FileFormatError, match="no such file"):
        read_rows(tmp_path / "none.csv")


def test_spreadsheets_say_their_separator() -> None:
    assert rows_of("sep=;\nx;y\n1,5;2\n", "a.csv") == [(2, ["x", "y"]), (3, ["1.5", "2"])]


def test_blanks_are_no_separator() -> None:
    with pytest.raises(FileFormatError, match="the header has no separator"):
        rows_of("x_mm y_mm\n1 2\n", "a.csv")
