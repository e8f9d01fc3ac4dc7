"""Deviations of a part: what is written is what is read; a damaged row or entry is named."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import FileFormatError, InputError
from counterflex.evaluate.inspection.part_deviations import PartDeviations
from counterflex.files.part_deviations import (
    KIND,
    VERSION,
    MeasuredPart,
    read_part_deviations,
    write_part_deviations,
)

PART = MeasuredPart("part.ngc", "ab" * 32, "scan.ply", "mm", ("top", "x-", "y-"), 12.5)


def rows(n: int, seed: int) -> PartDeviations:
    """Rows of a part, every number different."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    off = rng.normal(size=n)
    return PartDeviations(rng.normal(size=(n, 3)), normals, 1e-4 * off, 1e-5 * np.abs(off), rng.integers(0, 3, n))


@given(st.integers(0, 30), st.integers(0, 10**6))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, n: int, seed: int) -> None:
    path = tmp_path_factory.mktemp("part") / "deviations.parquet"
    written = rows(n, seed)
    write_part_deviations(path, written, PART)
    again, part = read_part_deviations(path)
    assert part == PART
    for name in ("points", "normals", "deviation_m", "standard_deviation_m", "face"):
        np.testing.assert_allclose(getattr(again, name), getattr(written, name), rtol=1e-14, atol=0.0)


def test_columns_are_in_the_units_of_their_names(tmp_path: Path) -> None:
    path = tmp_path / "deviations.parquet"
    written = rows(5, 1)
    write_part_deviations(path, written, PART)
    table = pl.read_parquet(path)
    np.testing.assert_allclose(table["y_mm"].to_numpy(), 1e3 * written.points[:, 1], rtol=1e-13)
    np.testing.assert_allclose(table["deviation_um"].to_numpy(), 1e6 * written.deviation_m, rtol=1e-13)
    sigma = table["standard_deviation_um"].to_numpy()
    np.testing.assert_allclose(sigma, 1e6 * written.standard_deviation_m, rtol=1e-13)


def test_rows_that_mean_nothing_are_refused() -> None:
    good = rows(4, 2)
    with pytest.raises(InputError, match="row 2: a normal has no unit length"):
        replace(good, normals=good.normals * np.array([1.0, 1.0, 2.0, 1.0])[:, None])
    with pytest.raises(InputError, match="row 1: a standard deviation is negative"):
        replace(good, standard_deviation_m=np.array([0.0, -1e-6, 0.0, 0.0]))
    with pytest.raises(InputError, match="row 3: there is no such face"):
        replace(good, face=np.array([0, 1, 2, 3]))
    with pytest.raises(InputError):
        replace(good, deviation_m=np.array([0.0, np.nan, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("key", "value"),
    [("program", None), ("unit", 3), ("residual_um", "small"), ("residual_um", -1.0), ("datum_faces", [1])],
)
def test_metadata_that_mean_nothing_are_named(tmp_path: Path, key: str, value: object) -> None:
    path = tmp_path / "deviations.parquet"
    write_part_deviations(path, rows(3, 3), PART)
    meta = {"format": KIND, "version": VERSION, **asdict(PART), key: value}
    pl.read_parquet(path).write_parquet(path, metadata={"counterflex": json.dumps(meta)})
    with pytest.raises(FileFormatError, match=key.replace("datum_faces", "datum face")):
        read_part_deviations(path)


def test_damaged_rows_are_refused_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "deviations.parquet"
    write_part_deviations(path, rows(3, 4), PART)
    meta = {"counterflex": json.dumps({"format": KIND, "version": VERSION, **asdict(PART)})}
    pl.read_parquet(path).with_columns(pl.lit(9).alias("face")).write_parquet(path, metadata=meta)
    with pytest.raises(FileFormatError, match=r"deviations\.parquet.*no such face"):
        read_part_deviations(path)
