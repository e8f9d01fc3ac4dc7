"""A file of another kind where a TOML file is read is named, with what to give instead; counts say what was given."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Annotated

import polars
import pytest
from pydantic import Field

from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import read_cell
from counterflex.files.dataset.manifest import read_manifest
from counterflex.files.schema import Table, parse


def workbook() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as book:
        book.writestr("xl/workbook.xml", "<workbook/>")
    return stream.getvalue()


def parquet() -> bytes:
    stream = io.BytesIO()
    polars.DataFrame({"A1": [1.0]}).write_parquet(stream)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("poses.xlsx", workbook(), "workbook"),
        ("poses.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(100), "workbook"),
        ("poses.parquet", parquet(), "Parquet"),
        ("poses.csv", b"A1;A2;x\n1,5;2,5;3\n1,6;2,6;4\n", "a table of data (CSV)"),
        ("poses.txt", b"# exported\nA1\tA2\tx\n1\t2\t3\n", "a table of data (CSV)"),
        ("bom.csv", b"\xef\xbb\xbfA1,A2\r\n1,2\r\n", "a table of data (CSV)"),
        ("poses.json", b'{"A1": [1, 2]}', "JSON"),
        ("poses.xml", b'<?xml version="1.0"?>\n<poses/>', "XML"),
        ("part.ngc", b"%\nG21 G90 (mm, absolute)\nT1 M6\n", "a G-code program"),
        ("numbered.nc", b"(PART, 3 CUTS)\nN10 G21\nN20 G0 X0\n", "a G-code program"),
        ("poses.mat", b"MATLAB 5.0 MAT-file, Platform: PCWIN64", "MATLAB"),
    ],
)
def test_a_data_file_given_as_the_manifest_is_named(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(FileFormatError) as fault:
        read_manifest(file)
    assert said in fault.value.what
    assert "manifest" in str(fault.value)
    assert "\n" not in str(fault.value)
    with pytest.raises(FileFormatError, match="counterflex-cell"):
        read_cell(file)


@pytest.mark.parametrize(
    "text", ['format = "x\n', "[files\n", 'name = "a"\nA1;A2\n', '[[files]]\npath = "a.csv"\ncolumns = 1;2\n']
)
def test_toml_with_a_mistake_stays_toml(tmp_path: Path, text: str) -> None:
    file = tmp_path / "m.toml"
    file.write_text(text)
    with pytest.raises(FileFormatError, match="not valid TOML"):
        read_manifest(file)


class Counted(Table):
    p_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    few: Annotated[tuple[float, ...], Field(min_length=2, max_length=3)] = (0.0, 0.0)


@pytest.mark.parametrize(
    ("key", "count", "limit"), [("p_mm", 2, "3"), ("p_mm", 4, "3"), ("few", 1, "2"), ("few", 4, "3")]
)
def test_a_list_of_another_length_says_how_many_there_are(key: str, count: int, limit: str) -> None:
    with pytest.raises(FileFormatError) as fault:
        parse(Counted, {key: [1.0] * count}, where="file")
    assert f"got {count} " in str(fault.value)
    assert limit in str(fault.value).split("expected")[1]


def test_a_file_of_another_command_is_named_with_the_option_that_reads_it(tmp_path: Path) -> None:
    file = tmp_path / "truth.toml"
    file.write_text('format = "counterflex-truth"\nversion = 1\n')
    with pytest.raises(FileFormatError, match="truth file, as --truth reads it"):
        read_cell(file)
