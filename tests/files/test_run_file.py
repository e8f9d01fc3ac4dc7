"""Run files: what is written is what is read; summaries likewise."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st

from counterflex.core.errors import FileFormatError
from counterflex.evaluate.summary import FORMAT, VERSION as SUMMARY_VERSION
from counterflex.files.summary_file import (
    AXIS,
    KIND,
    LAYOUT,
    RUN_VERSION,
    read_run,
    read_summary,
    write_run,
    write_summary,
)
from counterflex.path.toolpath import Run

COLUMNS = LAYOUT + AXIS


def a_run(n: int, seed: int) -> Run:
    """A run of n rows, every number different."""
    rng = np.random.default_rng(seed)
    width = Counter(column.field for column in COLUMNS)
    single = {column.field for column in COLUMNS if column.index is None}
    fields: dict[str, Any] = {}
    for column in COLUMNS:
        shape = (n,) if column.field in single else (n, width[column.field])
        fields[column.field] = rng.integers(0, 9, n) if column.whole else rng.normal(size=shape)
    return Run(**fields)


@given(st.integers(0, 40), st.integers(0, 10**6))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, n: int, seed: int) -> None:
    path = tmp_path_factory.mktemp("run") / "run.parquet"
    run = a_run(n, seed)
    write_run(path, run, {"seed": seed})
    again, about = read_run(path)
    assert about == {"format": KIND, "version": RUN_VERSION, "seed": seed}
    for field in dataclasses.fields(Run):
        one, two = getattr(run, field.name), getattr(again, field.name)
        assert one.dtype == two.dtype
        np.testing.assert_allclose(one, two, rtol=1e-14, atol=0.0)


def test_every_number_of_a_run_has_a_column() -> None:
    assert {column.field for column in COLUMNS} == {field.name for field in dataclasses.fields(Run)}
    assert len({column.name for column in COLUMNS}) == len(COLUMNS)


def test_version_1_has_no_direction_of_the_tool(tmp_path: Path) -> None:
    path, run = tmp_path / "run.parquet", dataclasses.replace(a_run(4, 2), axis_part=None)
    write_run(path, run, {})
    meta = json.dumps({"format": KIND, "version": 1})
    pl.read_parquet(path).write_parquet(path, metadata={"counterflex": meta})
    again, about = read_run(path)
    assert about["version"] == 1
    assert again.axis_part is None
    np.testing.assert_allclose(again.p_part_tcp, run.p_part_tcp, rtol=1e-14)
    pl.read_parquet(path).with_columns(axis_x=pl.lit(1.0)).write_parquet(path, metadata={"counterflex": meta})
    with pytest.raises(FileFormatError, match="missing or unknown.*axis_y"):
        read_run(path)


def test_units_are_those_of_the_column_names(tmp_path: Path) -> None:
    run = a_run(3, 1)
    write_run(tmp_path / "run.parquet", run, {})
    table = pl.read_parquet(tmp_path / "run.parquet")
    np.testing.assert_allclose(table["axial_depth_mm"].to_numpy(), run.depth_m * 1e3, rtol=1e-13)
    np.testing.assert_allclose(table["q2_deg"].to_numpy(), np.degrees(run.q_motor[:, 1]), rtol=1e-13)
    np.testing.assert_allclose(table["time_s"].to_numpy(), run.time_s, rtol=1e-13)


@pytest.mark.parametrize("version", [RUN_VERSION + 1, None, "1", True, 0])
def test_versions_that_are_refused(tmp_path: Path, version: Any) -> None:
    path = tmp_path / "run.parquet"
    write_run(path, a_run(2, 1), {})
    meta = {"format": KIND} if version is None else {"format": KIND, "version": version}
    pl.read_parquet(path).write_parquet(path, metadata={"counterflex": json.dumps(meta)})
    with pytest.raises(FileFormatError, match="version|newer"):
        read_run(path)


plain = st.one_of(st.none(), st.booleans(), st.integers(-(2**50), 2**50), st.text(max_size=9), st.floats(-1e9, 1e9))


@given(st.dictionaries(st.text(min_size=1, max_size=9).filter(lambda key: key not in ("format", "version")), plain))
def test_summary_round_trip(tmp_path_factory: pytest.TempPathFactory, data: dict[str, Any]) -> None:
    path = tmp_path_factory.mktemp("summary") / "summary.json"
    write_summary(path, data)
    assert read_summary(path) == {"format": FORMAT, "version": SUMMARY_VERSION, **data}


def test_truth_levels_of_version_1_get_their_present_names(tmp_path: Path) -> None:
    old = {
        "truth_level": "seeded",
        "seeds": [{"seed": 1, "truth_level": "same"}],
        "over_seeds": {"seeded": {}, "same": {}},
    }
    path = tmp_path / "summary.json"
    path.write_text(json.dumps({"format": FORMAT, "version": 1, **old}), encoding="utf-8")
    now = read_summary(path)
    assert (now["truth_level"], now["seeds"][0]["truth_level"]) == ("catalogue", "exact")
    assert list(now["over_seeds"]) == ["catalogue", "exact"]


def test_summary_holds_no_number_that_json_lacks(tmp_path: Path) -> None:
    write_summary(tmp_path / "summary.json", {"a": float("nan"), "b": [float("inf"), {"c": -float("inf")}]})
    data = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert data["a"] is None
    assert data["b"] == [None, {"c": None}]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "not readable as JSON"),
        ("[]", "not a counterflex-summary file"),
        ('{"format": "other"}', "not a counterflex-summary file"),
        ('{"format": "counterflex-summary", "version": 99}', "newer .*99"),
        ('{"format": "counterflex-summary"}', "newer|version"),
    ],
)
def test_summary_refused(tmp_path: Path, text: str, match: str) -> None:
    path = tmp_path / "summary.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=match):
        read_summary(path)
    with pytest.raises(FileFormatError, match="no such file"):
        read_summary(tmp_path / "none.json")
