"""Mistakes that people make in manifests and exports: each is one clear error, none loses a row or a number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError
from counterflex.files.dataset.reader import read_dataset
from counterflex.identify.data.dataset import Dataset

HEADER = "A1,A2,A3,A4,A5,A6,x,y,z\n"
ROWS = "10,20,30,40,50,60,1000,2000,1500\n11,21,31,41,51,61,1001,2001,1501\n12,22,32,42,52,62,1002,2002,1502\n"
NAMED = ('["A1","A2","A3","A4","A5","A6"]', '["x","y","z"]')
NUMBERED = ("[1,2,3,4,5,6]", "[7,8,9]")


def read(
    folder: Path, text: str, files: str = "", columns: tuple[str, str] = NAMED, extra: str = "sigma = 0.01"
) -> Dataset:
    (folder / "d.csv").write_text(text, encoding="utf-8")
    (folder / "m.toml").write_text(
        'format = "counterflex-dataset"\nversion = 1\nname = "a"\nkind = "tracker_poses"\n'
        f'[[files]]\npath = "d.csv"\n{files}\n[channels.q]\ncolumns = {columns[0]}\nunit = "deg"\n'
        f'[channels.p_tracker_target]\ncolumns = {columns[1]}\nunit = "mm"\n{extra}\n'
    )
    return read_dataset(folder / "m.toml")


def said(folder: Path, text: str, files: str = "", columns: tuple[str, str] = NAMED, extra: str = "") -> str:
    with pytest.raises(FileFormatError) as fault:
        read(folder, text, files, columns, extra)
    assert "\n" not in str(fault.value)
    return str(fault.value)


@pytest.mark.parametrize("first", [ROWS, "nan," + ROWS.partition(",")[2], "1e3," + ROWS.partition(",")[2]])
@pytest.mark.parametrize("columns", [NAMED, NUMBERED], ids=["by name", "by number"])
def test_the_first_measurement_of_a_file_without_names_is_never_lost(
    tmp_path: Path, first: str, columns: tuple[str, str]
) -> None:
    message = said(tmp_path, first, columns=columns)
    assert "d.csv:1: the header line holds numbers only" in message
    assert "header_line = 0" in message


def test_without_names_every_row_is_read_and_columns_are_numbers(tmp_path: Path) -> None:
    found = read(tmp_path, ROWS, "header_line = 0", NUMBERED)
    np.testing.assert_allclose(found.values("p_tracker_target")[:, 0], [1.0, 1.001, 1.002])
    # Names that count the columns are names, as are numbers that the manifest skips as such.
    assert len(read(tmp_path, "1,2,3,4,5,6,7,8,9\n" + ROWS, "", NUMBERED)) == 3
    assert len(read(tmp_path, "0.1,0.2,0.3,1,1,1,1,1,1\n" + ROWS, "header_line = 0\nskip_lines = [1]", NUMBERED)) == 3


@pytest.mark.parametrize(
    ("text", "files", "columns", "expected"),
    [
        (HEADER + ROWS, "header_line = 0", NUMBERED, "header_line = 1"),
        ("Measurement of 3 May\n" + HEADER + ROWS, "", NAMED, "header_line = 2"),
        ("# exported\n# by hand\n" + HEADER + ROWS, "", NAMED, "has one cell: is it a title?"),
        ((HEADER + ROWS).replace(",", ";").replace("10;", "10,5;"), "", NAMED, 'separator = ";" and decimal = ","'),
        ((HEADER + ROWS).replace(",", "\t"), "", NAMED, 'separator = "tab"'),
        (HEADER + ROWS.replace("1000", '"1,000"'), "", NAMED, 'thousands = ","'),
        (HEADER + ROWS.replace("1000", "1.0D3"), "", NAMED, "1.2345E3"),
        ("", "", NAMED, "the file is empty"),
        (HEADER + ROWS, "header_line = 9", NAMED, "expected 1..4"),
    ],
    ids=["names counted as data", "title", "comments", "decimal commas", "tabs", "thousands", "D", "empty", "beyond"],
)
def test_habits_of_exports_are_named_with_what_to_write(
    tmp_path: Path, text: str, files: str, columns: tuple[str, str], expected: str
) -> None:
    assert expected in said(tmp_path, text, files, columns)


@pytest.mark.parametrize("extra", ["sigma = 0.02\nsigma_coverage = 2", "sigma_coverage = 2"])
def test_a_coverage_that_would_be_ignored_is_refused(tmp_path: Path, extra: str) -> None:
    message = said(tmp_path, HEADER + ROWS, extra=extra)
    assert "sigma_coverage = 2 belongs to sigma_columns" in message
    assert "divide sigma" in message


def test_a_coverage_of_columns_is_used(tmp_path: Path) -> None:
    text = "\n".join(f"{line},0.02" if k else f"{line},U" for k, line in enumerate((HEADER + ROWS).splitlines()))
    found = read(tmp_path, text, extra='sigma_columns = ["U"]\nsigma_coverage = 2')
    np.testing.assert_allclose(found.channel("p_tracker_target").need_sigma(), 1e-5)


def test_a_sigma_unit_without_sigma_is_refused(tmp_path: Path) -> None:
    assert "sigma_unit" in said(tmp_path, HEADER + ROWS, extra='sigma_unit = "um"')


@pytest.mark.parametrize("columns", [(NAMED[0], '["A1","y","z"]'), (NUMBERED[0], "[6,7,8]")])
def test_a_column_of_two_quantities_is_refused(tmp_path: Path, columns: tuple[str, str]) -> None:
    message = said(tmp_path, HEADER + ROWS, columns=columns)
    assert "one column is taken for two different quantities" in message
    assert "'A1'" in message or "'A6'" in message


def test_one_column_may_be_two_clocks(tmp_path: Path) -> None:
    text = (HEADER + ROWS).replace("A1,", "t,A1,").replace("\n1", "\n0.1,1")
    clock = 'columns = ["t"]\nunit = "s"\n'
    found = read(tmp_path, text, extra=f"sigma = 1\n[channels.time_s]\n{clock}[channels.time_tracker_s]\n{clock}")
    np.testing.assert_array_equal(found.values("time_s"), found.values("time_tracker_s"))
