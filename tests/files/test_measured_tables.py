"""Small tables that people write: touches, approaches, tap tests, errors of a path; units and directions by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import polars
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from counterflex.core.errors import FileFormatError
from counterflex.evaluate.iso230.positioning import DOWN, UP
from counterflex.evaluate.path_error.learning import MeasuredError
from counterflex.files.part_deviations import read_path_error, write_path_error
from counterflex.files.positioning_file import read_approaches
from counterflex.files.tap_test import read_tap_test
from counterflex.files.touches_file import read_touches

QUICK = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
seed = st.integers(0, 2**31)


def table(file: Path, columns: dict[str, list[object]], order: list[str]) -> Path:
    """Write columns in an order, with a comment and an empty line."""
    rows = zip(*(columns[name] for name in order), strict=True)
    lines = ["# by hand", ",".join(order), "", *(",".join(map(str, row)) for row in rows)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


@QUICK
@given(seed, st.sets(st.sampled_from(["spindle_rpm", "sigma_um", "temperature_c"])), st.booleans())
def test_touches_count_from_the_first_one(tmp_path: Path, number: int, known: set[str], backwards: bool) -> None:
    """Columns in any order; a spindle that turns left warms as one that turns right; no temperature is none."""
    rng = np.random.default_rng(number)
    n = 6
    time_s = np.cumsum(rng.uniform(1.0, 900.0, n))
    place, rpm = rng.uniform(-500.0, 500.0, (n, 3)), rng.uniform(0.0, 18e3, n) * (-1.0 if backwards else 1.0)
    sigma, warm = rng.uniform(0.5, 20.0, n), rng.uniform(18.0, 60.0, n)
    columns: dict[str, list[object]] = {"time_s": time_s.tolist(), "x_mm": place[:, 0].tolist(),
                                        "y_mm": place[:, 1].tolist(), "z_mm": place[:, 2].tolist()}  # fmt: skip
    of_file = {
        "spindle_rpm": rpm.tolist(),
        "sigma_um": sigma.tolist(),
        "temperature_c": ["" if k == 2 else v for k, v in enumerate(warm)],
    }
    columns |= {name: of_file[name] for name in sorted(known)}
    order = [list(columns)[k] for k in rng.permutation(len(columns))]
    found = read_touches(table(tmp_path / "touches.csv", columns, order))
    np.testing.assert_allclose(found.time_s, time_s)
    np.testing.assert_allclose(found.deviation_m, 1e-3 * (place - place[0]), atol=1e-15)
    speed = np.abs(rpm) * 2.0 * math.pi / 60.0 if "spindle_rpm" in known else np.zeros(n)
    np.testing.assert_allclose(found.speed_rad_s, speed)
    np.testing.assert_allclose(found.sigma_m, 1e-6 * (sigma if "sigma_um" in known else np.full(n, 5.0)))
    kelvin = np.where(np.arange(n) == 2, np.nan, warm - warm[0]) if "temperature_c" in known else np.full(n, np.nan)
    np.testing.assert_allclose(found.warmer_k, kelvin)


@pytest.mark.parametrize("missing", [1, 2])
def test_a_first_touch_without_a_temperature_is_refused_where_others_have_one(tmp_path: Path, missing: int) -> None:
    """All later temperatures were dropped, and the page said nothing of it."""
    rows: list[object] = ["", 21.5, 22.0, 22.5]
    rows[1] = "" if missing == 2 else rows[1]
    columns: dict[str, list[object]] = {name: [0.0, 1.0, 2.0, 3.0] for name in ("time_s", "x_mm", "y_mm", "z_mm")}
    file = table(tmp_path / "touches.csv", columns | {"temperature_c": rows}, [*columns, "temperature_c"])
    with pytest.raises(FileFormatError, match="temperature_c of the first touch is missing") as fault:
        read_touches(file)
    assert f"{rows[missing]:g} first at time_s {missing}" in str(fault.value)
    none = table(tmp_path / "none.csv", columns | {"temperature_c": [""] * 4}, [*columns, "temperature_c"])
    assert np.isnan(read_touches(none).warmer_k).all()


@QUICK
@given(seed, st.sampled_from(["position_mm", "deviation_mm", "deviation_um"]), st.booleans(), st.booleans())
def test_approaches_are_the_same_however_they_are_written(
    tmp_path: Path, number: int, measured: str, said: bool, falling: bool
) -> None:
    """Position or deviation, direction said or by the order of the targets: there, over the end, and back."""
    rng = np.random.default_rng(number)
    targets = np.cumsum(rng.uniform(5.0, 80.0, 5)) * (-1.0 if falling else 1.0)
    target = np.concatenate([targets, targets[::-1], targets])  # at both ends the axis overran and came back
    there = DOWN if falling else UP
    way = np.repeat([there, -there, there], 5)
    off_um = rng.normal(scale=8.0, size=15)
    values = {"position_mm": target + 1e-3 * off_um, "deviation_mm": 1e-3 * off_um, "deviation_um": off_um}
    columns: dict[str, list[object]] = {"target_mm": target.tolist(), measured: values[measured].tolist()}
    if said:
        words = {UP: ("+", "up", "Forward"), DOWN: ("-", "down", "backward")}
        columns["direction"] = [words[int(w)][k % 3] for k, w in enumerate(way)]
    order = [list(columns)[k] for k in rng.permutation(len(columns))]
    found = read_approaches(table(tmp_path / "axis.csv", columns, order))
    np.testing.assert_allclose(found.target_m, 1e-3 * target)
    np.testing.assert_allclose(found.deviation_m, 1e-6 * off_um, atol=1e-12)
    np.testing.assert_array_equal(found.direction, way)


@QUICK
@given(seed, st.booleans())
def test_a_tap_test_is_the_same_as_receptance_and_as_accelerance(
    tmp_path: Path, number: int, accelerated: bool
) -> None:
    """``a = -omega^2 x``; a push along -y is one along y turned round."""
    rng = np.random.default_rng(number)
    hz, n = rng.uniform(3.0, 200.0, 7), 7
    g = rng.normal(size=n) + 1j * rng.normal(size=n)  # um/N
    force, motion = (
        [("-" if rng.random() < 0.5 else "") + "xyz"[int(rng.integers(3))] for _ in range(n)] for _ in "ab"
    )
    a = -((2.0 * math.pi * hz) ** 2) * 1e-6 * g
    shown, names = (a, ("real_m_s2_n", "imag_m_s2_n")) if accelerated else (g, ("real_um_n", "imag_um_n"))
    columns: dict[str, list[object]] = {"frequency_hz": hz.tolist(), "force": [*force], "motion": [*motion],
                                        names[0]: shown.real.tolist(), names[1]: shown.imag.tolist()}  # fmt: skip
    order = [list(columns)[k] for k in rng.permutation(5)]
    found = read_tap_test(table(tmp_path / "tap.csv", columns, order))
    np.testing.assert_allclose(found.omega_rad_s, 2.0 * math.pi * hz)
    np.testing.assert_allclose(found.receptance, 1e-6 * g, rtol=1e-9)
    for words, axes in ((force, found.force_base), (motion, found.motion_base)):
        for word, axis in zip(words, axes, strict=True):
            expected = np.zeros(3)
            expected["xyz".index(word[-1])] = -1.0 if word[0] == "-" else 1.0
            np.testing.assert_array_equal(axis, expected)


@QUICK
@given(seed)
def test_the_error_of_a_path_comes_back_with_what_was_taken_and_what_was_seen(tmp_path: Path, number: int) -> None:
    rng = np.random.default_rng(number)
    taken, error, sigma = (rng.normal(size=(9, 3)) * 1e-4 for _ in range(3))
    one = MeasuredError(taken, error, np.abs(sigma), rng.random((9, 3)) < 0.5)
    write_path_error(tmp_path / "error.parquet", one, {"job": "correct", "part": number})
    found, about = read_path_error(tmp_path / "error.parquet")
    for name in ("taken_m", "error_m", "sigma_m"):
        np.testing.assert_allclose(getattr(found, name), getattr(one, name), atol=1e-15)
    np.testing.assert_array_equal(found.seen, one.seen)
    assert (about["job"], about["part"]) == ("correct", number)
    stored = polars.read_parquet(tmp_path / "error.parquet")
    for name, values in (("taken", taken), ("error", error), ("sigma", np.abs(sigma))):
        for k, axis in enumerate("xyz"):
            np.testing.assert_allclose(stored[f"{name}_{axis}_um"].to_numpy(), 1e6 * values[:, k], atol=1e-9)


@pytest.mark.parametrize("text", ["time_s,x_mm,y_mm\n0,1,2\n1,1,2\n", "time_s,x_mm,y_mm,z_mm,x_um\n0,1,2,3,4\n"])
def test_other_columns_are_refused_by_every_reader(tmp_path: Path, text: str) -> None:
    file = tmp_path / "table.csv"
    file.write_text(text)
    for read in (read_touches, read_approaches, read_tap_test):
        with pytest.raises(
            FileFormatError, match=r"other columns than those of .*table\.csv|table\.csv:1: other columns"
        ):
            read(file)
