"""Plan files: what is written is what is read, in the units of the column names."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st

from counterflex.core import atomic
from counterflex.core.errors import FileFormatError
from counterflex.files.plan_file import KIND, LAYOUT, MEASURED, VERSION, plan_table, read_plan, write_plan
from counterflex.files.summary_file import write_folder_summary
from counterflex.path.toolpath import ToolPath
from counterflex.plan.plan import Plan, job_hash
from counterflex.robot.model.controller_axes import MAKERS, from_geometry

ABOUT = {"program": "part.ngc", "cell": "a cell"}


def a_plan(n: int, seed: int) -> Plan:
    """A plan of n rows, every number different, with the gaps (NaN) that plans have."""
    rng = np.random.default_rng(seed)
    width = Counter(column.field for column in LAYOUT)
    single = {column.field for column in LAYOUT if column.index is None}
    fields: dict[str, Any] = {}
    for column in LAYOUT:
        shape = (n,) if column.field in single else (n, width[column.field])
        fields[column.field] = rng.integers(0, 9, n) if column.whole else rng.normal(size=shape)
    fields["path.motion"] = np.sort(fields["path.motion"])
    fields["path.time_s"] = np.cumsum(np.abs(fields["path.time_s"]))
    fields["entry_rad"][: n // 2] = np.nan
    path = ToolPath(**{name[5:]: fields.pop(name) for name in list(fields) if name.startswith("path.")})
    return Plan(path=path, **fields)


def same(a: Any, b: Any) -> None:
    """Whether two plans or paths hold the same numbers."""
    for field in dataclasses.fields(a):
        one, two = getattr(a, field.name), getattr(b, field.name)
        if one is None:
            assert two is None
        elif dataclasses.is_dataclass(one):
            same(one, two)
        else:
            assert one.dtype == two.dtype
            np.testing.assert_allclose(one, two, rtol=1e-14, atol=0.0)


def test_a_plan_of_another_folder_is_refused(tmp_path: Path) -> None:
    for name, seed in (("one", 1), ("two", 2)):
        with atomic.atomic_folder(tmp_path / name) as staging:
            write_plan(staging / "plan.parquet", a_plan(4, seed), ABOUT)
            write_folder_summary(staging, {})
    assert len(read_plan(tmp_path / "one" / "plan.parquet")[0].path) == 4
    shutil.copyfile(tmp_path / "two" / "plan.parquet", tmp_path / "one" / "plan.parquet")
    with pytest.raises(FileFormatError, match=r"plan\.parquet: the files of this folder do not belong together"):
        read_plan(tmp_path / "one" / "plan.parquet")
    shutil.copyfile(tmp_path / "two" / "plan.parquet", tmp_path / "alone.parquet")
    same(read_plan(tmp_path / "alone.parquet")[0], a_plan(4, 2))


@given(st.integers(0, 40), st.integers(0, 10**6))
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, n: int, seed: int) -> None:
    path = tmp_path_factory.mktemp("plan") / "plan.parquet"
    plan = a_plan(n, seed)
    write_plan(path, plan, ABOUT)
    again, about = read_plan(path)
    same(plan, again)
    assert about == {"format": KIND, "version": 1, **ABOUT, "job_hash": job_hash(plan)}
    assert [item.name for item in path.parent.iterdir()] == ["plan.parquet"]


def test_plan_corrected_from_parts_is_written_and_read(tmp_path: Path) -> None:
    plan = dataclasses.replace(a_plan(7, 3), measured_part=np.random.default_rng(4).normal(size=(7, 3)))
    write_plan(tmp_path / "plan.parquet", plan, ABOUT)
    again, about = read_plan(tmp_path / "plan.parquet")
    same(plan, again)
    assert about["version"] == VERSION
    table = pl.read_parquet(tmp_path / "plan.parquet")
    assert plan.measured_part is not None
    np.testing.assert_allclose(table["measured_y_um"].to_numpy(), 1e6 * plan.measured_part[:, 1])


def test_units_are_those_of_the_column_names(tmp_path: Path) -> None:
    plan = a_plan(3, 1)
    write_plan(tmp_path / "plan.parquet", plan, ABOUT)
    table = pl.read_parquet(tmp_path / "plan.parquet")
    for column, values in {
        "x_mm": plan.path.p_part_tcp[:, 0] * 1e3,
        "feed_mm_min": plan.path.feed_m_s * 6e4,
        "spindle_rpm": plan.path.spindle_rad_s * 30.0 / np.pi,
        "q3_deg": np.degrees(plan.q[:, 2]),
        "fy_n": plan.w_tcp_part[:, 1],
        "mz_nm": plan.w_tcp_part[:, 5],
        "deflection_z_um": plan.deflection_part[:, 2] * 1e6,
        "deflection_rx_urad": plan.deflection_part[:, 3] * 1e6,
        "correction_y_um": plan.correction_part[:, 1] * 1e6,
        "volume_mm3": plan.volume_m3 * 1e9,
        "axial_depth_mm": plan.axial_depth_m * 1e3,
        "exit_deg": np.degrees(plan.exit_rad),
    }.items():
        np.testing.assert_allclose(table[column].to_numpy(), values, rtol=1e-13)


def test_every_number_of_a_plan_has_a_column() -> None:
    names = {field.name for field in dataclasses.fields(Plan)} - {"path", "chip_m", "recut"}
    names |= {f"path.{field.name}" for field in dataclasses.fields(ToolPath)}
    names -= {"path.place"}  # commands that read plans take external axes that stand
    assert {column.field for column in LAYOUT + MEASURED} == names
    assert len({column.name for column in LAYOUT}) == len(LAYOUT)


def _rewrite(path: Path, frame: pl.DataFrame, meta: Any) -> None:
    frame.write_parquet(path, metadata={"counterflex": meta if isinstance(meta, str) else json.dumps(meta)})


@pytest.mark.parametrize(
    ("meta", "drop", "match"),
    [
        ({"format": KIND, "version": VERSION + 1}, None, "newer .*expected at most"),
        ({"format": KIND, "version": "1"}, None, "newer|version"),
        ({"format": "counterflex-run", "version": 1}, None, f"not a {KIND} file; got 'counterflex-run'"),
        ({}, None, f"not a {KIND} file"),
        ("[1]", None, f"not a {KIND} file"),
        ("not json", None, "not readable"),
        ({"format": KIND, "version": VERSION}, "fx_n", "missing or unknown.*fx_n"),
    ],
)
def test_refused(tmp_path: Path, meta: Any, drop: str | None, match: str) -> None:
    path = tmp_path / "plan.parquet"
    write_plan(path, a_plan(2, 1), ABOUT)
    frame = pl.read_parquet(path)
    _rewrite(path, frame if drop is None else frame.drop(drop), meta)
    with pytest.raises(FileFormatError, match=match) as fault:
        read_plan(path)
    assert str(fault.value).startswith(str(path))


def test_a_column_of_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.parquet"
    write_plan(path, a_plan(2, 1), ABOUT)
    frame = pl.read_parquet(path).with_columns(pl.lit("much").alias("fx_n"))
    _rewrite(path, frame, {"format": KIND, "version": VERSION})
    with pytest.raises(FileFormatError, match=r"fx_n.*number"):
        read_plan(path)


def test_columns_that_are_not_known_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.parquet"
    write_plan(path, a_plan(2, 1), ABOUT)
    frame = pl.read_parquet(path).with_columns(pl.lit(1.0).alias("temperature_k"))
    _rewrite(path, frame, {"format": KIND, "version": VERSION})
    with pytest.raises(FileFormatError, match="temperature_k"):
        read_plan(path)


def test_missing_and_damaged_files(tmp_path: Path) -> None:
    (tmp_path / "plan.parquet").write_bytes(b"PAR1 and nothing else")
    with pytest.raises(FileFormatError, match="not readable as a Parquet file"):
        read_plan(tmp_path / "plan.parquet")
    with pytest.raises(FileFormatError, match=r"no such file. Did you mean plan.parquet\?"):
        read_plan(tmp_path / "plans.parquet")


def test_a_plan_file_shows_the_axes_of_the_controller(tmp_path: Path) -> None:
    plan = a_plan(5, 3)
    axes = from_geometry("fanuc", MAKERS["fanuc"].signs, (0.0, 0.0, -np.pi / 2, 0.0, 0.0, -np.pi), 0.67)
    write_plan(tmp_path / "plan.parquet", plan, {}, axes)
    shown = plan_table(plan, axes)
    np.testing.assert_allclose(shown["q3_deg"].to_numpy(), np.degrees(plan.q[:, 2] - plan.q[:, 1]), rtol=1e-12)
    back, about = read_plan(tmp_path / "plan.parquet")
    np.testing.assert_allclose(back.q, plan.q, rtol=1e-12)
    assert about["job_hash"] == job_hash(plan)
