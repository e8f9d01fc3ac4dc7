"""Small files that unpack to gigabytes, files without an end, deep ones: one line before memory is taken."""

from __future__ import annotations

import io
import os
import resource
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from counterflex.core import file_content
from counterflex.core.errors import FileFormatError
from counterflex.cutting.stock import HeightMap
from counterflex.cutting.tridexel.column_file import load_columns
from counterflex.files.dataset.instrument_files import instrument_columns
from counterflex.files.dataset.manifest import FileTable
from counterflex.files.dataset.table import read_table
from counterflex.files.plan_file import read_plan
from counterflex.files.schema import read_toml

LIMIT: Final = 2**26
"""Bytes, in place of those of the program, so that the test is short."""
ROOM: Final = 2**28
"""Bytes of memory that a refusal may take; the files unpack to more than twice as much."""
COUNT: Final = 80_000_000


def _parquet(file: Path) -> None:
    column = pl.select(pl.repeat(0.0, 1_000_000, dtype=pl.Float64).alias("a"))["a"]
    pl.DataFrame({f"c{k}": column for k in range(COUNT // 1_000_000)}).write_parquet(file, compression="zstd")


def _parquet_of_texts(file: Path) -> None:
    word = "x" * 1_000_000
    pl.select(pl.repeat(word, 1000).alias("a")).write_parquet(file, compression="zstd")


def _parquet_of_lists(file: Path) -> None:
    pl.DataFrame({"a": [[0.0] * 10] * 3}).write_parquet(file)


def _npz(file: Path) -> None:
    """An array of zeros, packed piece by piece."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (COUNT,)})
    piece = bytes(8_000_000)
    with (
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("z_m.npy", "w", force_zip64=True) as stream,
    ):
        stream.write(head.getvalue())
        for _ in range(COUNT // 1_000_000):
            stream.write(piece)


def _mat(file: Path) -> None:
    """An element that says how much it holds, of zeros."""
    import zlib

    savemat(file, {"a": np.zeros(2)}, do_compression=True)
    pack, piece = zlib.compressobj(1), bytes(8_000_000)
    packed = b"".join([pack.compress(piece) for _ in range(COUNT // 1_000_000)]) + pack.flush()
    head = (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little")
    file.write_bytes(file.read_bytes()[:128] + head + packed)


def _sparse(file: Path) -> None:
    with file.open("wb") as stream:
        stream.truncate(2**40)


def _endless(file: Path) -> None:
    file.symlink_to("/dev/zero")


READERS: Final[dict[str, Callable[[Path], object]]] = {
    "plan": read_plan,
    "table": lambda file: read_table(file, FileTable(path=file.name)),
    "stock": HeightMap.load,
    "columns": load_columns,
    "matlab": lambda file: instrument_columns(file, file_content.content(file), None),
    "toml": lambda file: read_toml(file, kind="counterflex-cell"),
}
TRIES: Final[dict[str, tuple[Callable[[Path], None], tuple[str, ...], str]]] = {
    "zeros.parquet": (_parquet, ("plan", "table"), "unpacks to more than it may"),
    "texts.parquet": (_parquet_of_texts, ("table",), "unpacks to more than it may"),
    "lists.parquet": (_parquet_of_lists, ("plan", "table"), "holds no plain values"),
    "zeros.npz": (_npz, ("stock", "columns"), "unpacks to more than it may"),
    "zeros.mat": (_mat, ("matlab", "table"), "unpacks to more than it may"),
    "sparse.toml": (_sparse, ("toml",), "too large"),
    "endless.toml": (_endless, ("toml",), "too large"),
}


def _refused(reader: str, file: Path) -> None:
    """Read a file with little memory left: what takes more ends with another fault, not with the refusal."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    taken = pages * os.sysconf("SC_PAGE_SIZE")
    vars(file_content).update(LARGEST_BYTES=LIMIT, LARGEST_TABLE_BYTES=LIMIT)
    resource.setrlimit(resource.RLIMIT_AS, (taken + ROOM, resource.RLIM_INFINITY))
    try:
        READERS[reader](file)
    except FileFormatError as fault:
        print(fault)


@pytest.mark.by_turn
@pytest.mark.parametrize("name", TRIES)
def test_a_small_file_that_unpacks_to_gigabytes_is_refused_before(tmp_path: Path, name: str) -> None:
    make, readers, said = TRIES[name]
    file = tmp_path / name
    make(file)
    call = f"import sys; sys.path[:] = {[str(Path(__file__).parent), *sys.path]!r}\n"
    call += "from pathlib import Path\nimport test_packed_files as t\n"
    call += f"for reader in {readers!r}:\n    t._refused(reader, Path({str(file)!r}))"
    ended = subprocess.run(
        [sys.executable, "-c", call], env=os.environ | {"POLARS_MAX_THREADS": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = ended.stdout.splitlines()
    assert len(lines) == len(readers), ended
    for line in lines:
        assert said in line
        assert str(file) in line


def test_what_is_just_small_enough_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.bin"
    file.write_bytes(b"x" * 100)
    monkeypatch.setattr(file_content, "LARGEST_BYTES", 100)
    assert len(file_content.content(file)) == 100
    monkeypatch.setattr(file_content, "LARGEST_BYTES", 99)
    with pytest.raises(FileFormatError, match="got 100 bytes; expected at most 99 bytes"):
        file_content.content(file)


DEEP: Final = 100_000


@pytest.mark.parametrize("text", ["[" * DEEP, "[" * DEEP + "]" * DEEP, '{"a":' * DEEP + "1" + "}" * DEEP])
def test_a_hundred_thousand_levels_are_one_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "deep.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match="nested too deeply"):
        file_content.json_value(file)
    file = tmp_path / "deep.toml"
    file.write_text("a = " + text.replace('"a":', "a = "), encoding="utf-8")
    with pytest.raises(FileFormatError, match=r"nested too deeply|not valid TOML") as told:
        read_toml(file, kind="counterflex-cell")
    assert "\n" not in str(told.value)
