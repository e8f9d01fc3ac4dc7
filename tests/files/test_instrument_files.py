"""Files of instruments, written by their own libraries or as their format says, give the numbers that were written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.dataset.manifest import FileTable
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.dataset.table import TextTable, read_table

RNG = np.random.default_rng(5)
FORCE = RNG.normal(size=(24, 6)).round(6)
STEP = 0.0005


def column(table: TextTable, name: str) -> Float:
    """Numbers of a column."""
    return table.numbers(table.find(name, "test"))[0]


def lvm(path: Path, columns: str = "One", decimal: str = ".", segments: int = 3) -> None:
    """Segments of eight rows, each with a header of its own, a block of other data and a comment between."""
    text = f"LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t{decimal}\n"
    text += f"X_Columns\t{columns}\n***End_of_Header***\t\n\t\n***Start_Special***\nChannels\t99\n***End_Special***\n"
    for k in range(segments):
        text += "Channels\t2\t\t\nSamples\t8\t8\t\nX_Dimension\tTime\tTime\t\n"
        text += f"X0\t{8 * k * STEP:E}\t{8 * k * STEP:E}\t\nDelta_X\t{STEP}\t{STEP}\t\n***End_of_Header***\t\t\t\n"
        text += "X_Value\tFx\tFy\tComment\n"
        for j in range(8 * k, 8 * k + 8):
            x = f"{j * STEP:.6f}" if columns != "No" else ""
            text += f"{x}\t{FORCE[j, 0]:.6f}\t{FORCE[j, 1]:.6f}" + ("\tfirst" if j % 8 == 0 else "") + "\n"
        text += "\n"
    if decimal == ",":
        text = text.replace(".", ",").replace("X0,", "X0.")
    path.write_text(text, newline="\r\n")


@pytest.mark.parametrize(("columns", "decimal"), [("One", "."), ("One", ","), ("No", ".")])
def test_segments_of_lvm_are_one_table(tmp_path: Path, columns: str, decimal: str) -> None:
    lvm(tmp_path / "a.lvm", columns, decimal)
    table = read_table(tmp_path / "a.lvm", FileTable(path="a.lvm"))
    np.testing.assert_allclose(column(table, "Fy"), FORCE[:, 1])
    np.testing.assert_allclose(column(table, "X_Value"), STEP * np.arange(24), atol=1e-9)
    np.testing.assert_array_equal(column(table, "Segment"), np.repeat([1.0, 2.0, 3.0], 8))
    line = int(table.lines[10])
    assert f"{FORCE[10, 0]:.6f}".replace(".", decimal) in (tmp_path / "a.lvm").read_text().splitlines()[line - 1]


def test_one_segment_of_lvm_can_be_named(tmp_path: Path) -> None:
    lvm(tmp_path / "a.lvm")
    table = read_table(tmp_path / "a.lvm", FileTable(path="a.lvm", part=2))
    np.testing.assert_allclose(column(table, "Fx"), FORCE[8:16, 0])
    with pytest.raises(FileFormatError, match=r"no such segment.*1\.\.3"):
        read_table(tmp_path / "a.lvm", FileTable(path="a.lvm", part=4))


def test_segments_of_other_channels_are_not_mixed(tmp_path: Path) -> None:
    lvm(tmp_path / "a.lvm")
    text = (tmp_path / "a.lvm").read_text()
    head, _, tail = text.rpartition("X_Value\tFx\tFy")
    (tmp_path / "a.lvm").write_text(head + "X_Value\tFx\tTemperature" + tail)
    with pytest.raises(FileFormatError, match="other channels"):
        read_table(tmp_path / "a.lvm", FileTable(path="a.lvm"))


def tdms(path: Path) -> None:
    """Two groups, one of them with another length; the channels of the first in two segments."""
    with TdmsWriter(path) as writer:
        for rows in (slice(0, 10), slice(10, 24)):
            of_time = {"wf_increment": STEP, "wf_start_offset": 0.0}
            writer.write_segment(
                [ChannelObject("force", f"F{k}", FORCE[rows, k], properties=of_time) for k in range(3)]
                + [ChannelObject("slow", "T", FORCE[rows, 3][:5])]
            )


def test_groups_of_tdms(tmp_path: Path) -> None:
    tdms(tmp_path / "a.tdms")
    table = read_table(tmp_path / "a.tdms", FileTable(path="a.tdms", part="force"))
    np.testing.assert_allclose(column(table, "F2"), FORCE[:, 2])
    np.testing.assert_allclose(column(table, "time_s"), STEP * np.arange(24))
    with pytest.raises(FileFormatError, match="different lengths"):
        read_table(tmp_path / "a.tdms", FileTable(path="a.tdms"))
    with pytest.raises(FileFormatError, match="no such group.*force, slow"):
        read_table(tmp_path / "a.tdms", FileTable(path="a.tdms", part="fast"))


def test_variables_of_matlab(tmp_path: Path) -> None:
    file = tmp_path / "a.mat"
    savemat(file, {"t": STEP * np.arange(24), "F": FORCE, "run": {"x": FORCE[:, 4], "n": 3.0}, "name": "cut"})
    table = read_table(file, FileTable(path="a.mat"))
    np.testing.assert_allclose(column(table, "F 3"), FORCE[:, 2])
    np.testing.assert_allclose(column(table, "run.x"), FORCE[:, 4])
    savemat(file, {"F": FORCE, "other": np.arange(7.0)})
    with pytest.raises(FileFormatError, match="different lengths"):
        read_table(file, FileTable(path="a.mat"))
    np.testing.assert_allclose(column(read_table(file, FileTable(path="a.mat", part="F")), "F 6"), FORCE[:, 5])


@pytest.mark.parametrize("first", [b"MATLAB 7.3 MAT-file, Platform", b"MATLAB 5.0 MAT-file, cut off", b"TDSm\0\0"])
def test_unread_or_damaged_files_are_named(tmp_path: Path, first: bytes) -> None:
    file = tmp_path / "a.mat"
    file.write_bytes(first)
    with pytest.raises(FileFormatError, match=r"a\.mat"):
        read_table(file, FileTable(path="a.mat"))


def test_a_part_of_a_plain_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2\n")
    with pytest.raises(FileFormatError, match="no parts"):
        read_table(tmp_path / "a.csv", FileTable(path="a.csv", part="b"))


MANIFEST = """format = "counterflex-dataset"
version = 1
name = "forces"
kind = "sensor_motion"
[[files]]
path = "a.csv"
[channels.w_sensor]
columns = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
"""


def wrench(folder: Path, unit: str, header: Callable[[str], str] = lambda name: name) -> Float:
    """The wrench of a dataset whose manifest states a unit."""
    names = [header(name) for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")]
    rows = "".join(",".join(f"{v}" for v in row) + "\n" for row in FORCE.tolist())
    (folder / "a.csv").write_text(",".join(names) + "\n" + rows)
    columns = "[" + ", ".join(f'"{name}"' for name in names) + "]"
    text = MANIFEST.replace('["Fx", "Fy", "Fz", "Mx", "My", "Mz"]', columns)
    (folder / "a.toml").write_text(text + unit)
    return read_dataset(folder / "a.toml").channels["w_sensor"].values


def test_pounds_are_read(tmp_path: Path) -> None:
    """0.45359237 kg at 9.80665 m/s2; inch 25.4 mm."""
    pound = 0.45359237 * 9.80665
    got = wrench(tmp_path, 'unit = ["lbf", "lbf in"]\n')
    np.testing.assert_allclose(got[:, :3], FORCE[:, :3] * pound, rtol=1e-12)
    np.testing.assert_allclose(got[:, 3:], FORCE[:, 3:] * pound * 0.0254, rtol=1e-12)


def test_counts_and_volts_have_a_factor(tmp_path: Path) -> None:
    got = wrench(tmp_path, 'unit = ["N", "N m"]\nfactor = [0.25, 0.02]\n', lambda name: f"{name} [V]")
    np.testing.assert_allclose(got, FORCE * [0.25, 0.25, 0.25, 0.02, 0.02, 0.02], rtol=1e-12)
    each = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    got = wrench(tmp_path, f'unit = ["kN", "N m"]\nfactor = {each}\n', lambda name: f"{name} [counts]")
    np.testing.assert_allclose(got, FORCE * each * [1e3, 1e3, 1e3, 1.0, 1.0, 1.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "header", "word"),
    [
        ('unit = ["V", "V"]\n', "{}", "factor = N by V"),
        ('unit = ["counts", "counts"]\n', "{}", "factor = N by counts"),
        ('unit = ["N", "N m"]\n', "{} [V]", "factor = "),
        ("", "{} [V]", "factor = "),
        ('unit = ["N", "N m"]\nfactor = 2.0\n', "{}", "two quantities"),
        ('unit = ["N", "N m"]\nfactor = [1.0, 0.0]\n', "{}", "other than zero"),
        ("factor = [1.0, 2.0]\n", "{}", "unit is missing"),
    ],
)
def test_volts_are_never_taken_for_newtons(tmp_path: Path, unit: str, header: str, word: str) -> None:
    with pytest.raises(FileFormatError, match=word):
        wrench(tmp_path, unit, header.format)
