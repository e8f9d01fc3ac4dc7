"""Readings that are typed or come in a file of an instrument are read back as what they are."""

from __future__ import annotations

import json
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.studio.choices import choices
from counterflex.app.studio.measured_file import MeasuredFile
from counterflex.app.studio.measurement_form import MeasurementForm
from counterflex.app.studio.project import Project
from counterflex.core import atomic
from counterflex.core.errors import OutputError
from counterflex.core.units import DEG, MM
from counterflex.files.dataset.proposal import write_proposal
from counterflex.files.dataset.reader import read_dataset
from counterflex.identify.data.channels import CHANNELS_OF, KINDS, SAMPLED
from counterflex.identify.recipe import Proposal

ROWS = 6
Q_DEG = np.arange(6.0 * ROWS).reshape(ROWS, 6)
P_MM = np.column_stack([1000.0 + 10.0 * np.arange(ROWS), np.full(ROWS, -250.5), 700.0 - np.arange(ROWS)])


def proposed(folder: Path, kind: str) -> Path:
    """A proposal of a kind, with its form."""
    columns = {f"q{k + 1}_rad": Q_DEG[:, k] * DEG for k in range(6)}
    if kind == "pulls":
        columns |= {"fx_n": np.full(ROWS, 750.0), "fy_n": np.zeros(ROWS), "fz_n": np.zeros(ROWS)}
    folder.mkdir()
    write_proposal(folder, Proposal("some", kind, columns, {}))
    return folder


def column(form: MeasurementForm, name: str) -> int:
    return [one.name for one in form.columns].index(name)


def typed(form: MeasurementForm) -> None:
    """Type positions, each with a decimal comma."""
    for row, values in enumerate(P_MM):
        for axis, value in zip("xyz", values, strict=True):
            form.enter(row, column(form, f"p_tracker_target_{axis}_mm"), str(value).replace(".", ","))


@pytest.mark.parametrize("kind", sorted(KINDS.keys() & CHANNELS_OF.keys()))
def test_every_kind_has_a_form_that_can_be_read(tmp_path: Path, kind: str) -> None:
    form = MeasurementForm.read(proposed(tmp_path / "form", kind), "some")
    assert {one.channel for one in form.columns} == set(CHANNELS_OF[kind])
    assert len(form.rows) == (0 if kind in SAMPLED else ROWS)
    assert [one.state for one in form.remarks()] == ["todo"] * len(form.rows)


def test_what_is_typed_is_what_the_command_reads(tmp_path: Path) -> None:
    form = MeasurementForm.read(proposed(tmp_path / "form", "tracker_poses"), "some")
    typed(form)
    form.sigma["p_tracker_target", "mm"] = 0.02
    form.save()
    assert [one.state for one in form.remarks()] == ["done"] * ROWS
    data = read_dataset(form.manifest)
    np.testing.assert_allclose(data.values("p_tracker_target"), P_MM * MM, rtol=1e-12)
    np.testing.assert_allclose(data.values("q"), Q_DEG * DEG, rtol=1e-11)
    np.testing.assert_allclose(data.channel("p_tracker_target").need_sigma(), 0.02 * MM)
    assert not data.has("R_tracker_target")  # its columns are empty
    again = MeasurementForm.read(form.folder, "some")
    assert (again.rows, again.sigma) == (form.rows, form.sigma)


def test_an_entry_during_a_slow_save_is_no_other_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    form = MeasurementForm.read(proposed(tmp_path / "form", "tracker_poses"), "some")
    half, on, written = threading.Event(), threading.Event(), atomic.write_text

    def slow(path: Path, text: str) -> None:
        written(path, text)
        half.set()
        on.wait(0.5)  # the second save begins while the first has written the table alone

    monkeypatch.setattr(atomic, "write_text", slow)
    with ThreadPoolExecutor(3) as pool:
        typed(form)
        first = pool.submit(form.save)
        half.wait()
        form.sigma["p_tracker_target", "mm"] = 0.02
        second, current = pool.submit(form.save), pool.submit(form.is_current)
        first.result()
        on.set()
        second.result()
        assert current.result()
    assert MeasurementForm.read(form.folder, "some").rows == form.rows


def test_a_planned_load_stands_in_the_form_and_a_displacement_alone_is_enough(tmp_path: Path) -> None:
    form = MeasurementForm.read(proposed(tmp_path / "form", "pulls"), "some")
    assert [row[column(form, "f_tcp_base_fx_n")] for row in form.rows] == ["750"] * ROWS
    for row in range(ROWS):
        for axis in "xyz":
            form.enter(row, column(form, f"d_tcp_base_{axis}_mm"), f"0.{row + 1}")
    form.save()
    data = read_dataset(form.manifest)
    assert data.values("d_tcp_base").shape == (ROWS, 3)
    np.testing.assert_allclose(data.values("f_tcp_base")[:, 0], 750.0)


@pytest.mark.parametrize(
    ("row", "texts", "state", "word"),
    [
        (2, ("1.02", "-0.2505", "0.698"), "odd", "wrong unit"),
        (2, ("1010", "-250.5", "699"), "odd", "same reading as no. 2"),
        (3, ("1030", "", "697"), "bad", "missing: y"),
        (4, ("1.040,0", "-250.5", "696"), "bad", "no number"),
        (5, ("", "", ""), "todo", "not measured"),
    ],
)
def test_a_mistake_is_named_at_its_row(tmp_path: Path, row: int, texts: tuple[str, ...], state: str, word: str) -> None:
    form = MeasurementForm.read(proposed(tmp_path / "form", "tracker_points"), "some")
    typed(form)
    for axis, text in zip("xyz", texts, strict=True):
        form.enter(row, column(form, f"p_tracker_target_{axis}_mm"), text)
    remarks = form.remarks()
    assert remarks[row].state == state
    assert word in remarks[row].text
    assert {one.state for k, one in enumerate(remarks) if k != row} == {"done"}


def test_a_form_that_changed_on_disk_is_not_overwritten(tmp_path: Path) -> None:
    form = MeasurementForm.read(proposed(tmp_path / "form", "tracker_points"), "some")
    form.table.write_text("of another program", encoding="utf-8")
    typed(form)
    with pytest.raises(OutputError, match="changed by another program"):
        form.save()
    assert form.table.read_text(encoding="utf-8") == "of another program"


@pytest.mark.parametrize(
    ("head", "separator", "decimal"),
    [
        (["A1,A2,A3,A4,A5,A6,X [mm],Y [mm],Z [mm]"], ",", "."),
        (["q1;q2;q3;q4;q5;q6;x;y;z"], ";", ","),
        (["Tracker, 7 May", "J1\tJ2\tJ3\tJ4\tJ5\tJ6\tx_mm\ty_mm\tz_mm"], "\t", "."),
        (["A1;A2;A3;A4;A5;A6;X;Y;Z", "deg;deg;deg;deg;deg;deg;mm;mm;mm"], ";", ","),
    ],
)
def test_a_file_is_read_however_it_is_written(tmp_path: Path, head: list[str], separator: str, decimal: str) -> None:
    rows = [separator.join(f"{v:.3f}".replace(".", decimal) for v in row) for row in np.hstack([Q_DEG + 0.125, P_MM])]
    path = tmp_path / "tracker.csv"
    path.write_text("\n".join([*head, *rows]), encoding="utf-8")
    file = MeasuredFile.read(path, proposed(tmp_path / "form", "tracker_points"))
    file.write(tmp_path / "form" / "file.toml")
    data = read_dataset(tmp_path / "form" / "file.toml")
    np.testing.assert_allclose(data.values("q"), (Q_DEG + 0.125) * DEG)
    np.testing.assert_allclose(data.values("p_tracker_target"), P_MM * MM)


def test_poses_that_a_file_does_not_hold_are_those_proposed(tmp_path: Path) -> None:
    path = tmp_path / "tracker.csv"
    path.write_text("\n".join(["X (m),Y (m),Z (m)", *(f"{x},{y},{z}" for x, y, z in P_MM * MM)]), encoding="utf-8")
    file = MeasuredFile.read(path, proposed(tmp_path / "form", "tracker_points"))
    file.write(tmp_path / "form" / "file.toml")
    data = read_dataset(tmp_path / "form" / "file.toml")
    np.testing.assert_allclose(data.values("q"), Q_DEG * DEG, rtol=1e-11)
    np.testing.assert_allclose(data.values("p_tracker_target"), P_MM * MM)  # the header says metres


def test_a_rotation_is_read_in_the_convention_that_is_chosen(tmp_path: Path) -> None:
    """A quarter turn about z, as a quaternion and as a rotation vector."""
    path = tmp_path / "tracker.csv"
    half = np.sqrt(0.5)
    rows = [f"{x},{y},{z},{half},0,0,{half}" for x, y, z in P_MM]
    path.write_text("\n".join(["x,y,z,qw,qx,qy,qz", *rows]), encoding="utf-8")
    file = MeasuredFile.read(path, proposed(tmp_path / "form", "tracker_poses"))
    file.channels["R_tracker_target"].turn("quat_wxyz")
    file.channels["R_tracker_target"].columns = ["qw", "qx", "qy", "qz"]
    file.write(tmp_path / "form" / "file.toml")
    values = read_dataset(tmp_path / "form" / "file.toml").values("R_tracker_target")
    np.testing.assert_allclose(values[0], [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-12)


def test_choices_stand_side_by_side_with_their_gain(tmp_path: Path) -> None:
    summaries: dict[str, dict[str, Any]] = {
        "posture": {"present": {"deflection_um": 900.0, "expected_um": [1000.0, 500.0, 2000.0]},
                    "chosen": {"deflection_um": 600.0, "expected_um": [750.0, 400.0, 1500.0]}},
        "strategy": {"job": "plan strategy", "before": None, "choices": []},
        "krl": {"job": "compensate",
                "prediction": {"headline": {"before_mm": [1.0, 0.5, 2.0], "after_mm": [0.1, 0.0, 0.3]}}},
    }  # fmt: skip
    for name, summary in summaries.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(json.dumps({"program": "a.ngc", **summary}), encoding="utf-8")
    gains = {one.folder: one.gain_percent for one in choices(Project(tmp_path), "a.ngc")}
    assert gains == {"posture": pytest.approx(25.0), "krl": pytest.approx(90.0)}
    assert choices(Project(tmp_path), "b.ngc") == []


def test_a_choice_that_is_counted_on_one_side_alone_compares_the_model(tmp_path: Path) -> None:
    """A median over what is not known stands beside no model figure."""
    (tmp_path / "posture").mkdir()
    rows = {
        "present": {"deflection_um": 900.0, "expected_um": None},
        "chosen": {"deflection_um": 600.0, "expected_um": [750.0, 400.0, 1500.0]},
    }
    (tmp_path / "posture" / "summary.json").write_text(json.dumps({"program": "a.ngc", **rows}), encoding="utf-8")
    (one,) = choices(Project(tmp_path), "a.ngc")
    assert one.now_mm == pytest.approx([0.9] * 3)
    assert one.then_mm == pytest.approx([0.6] * 3)
    assert one.of.endswith("model without its unknowns")
    assert one.row()[2:4] == ["0.900", "0.600"]
