"""Measured response and modal parameters of the tool tip: what is read, and one clear error for what is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from counterflex.core.errors import FileFormatError
from counterflex.cutting.stability.modes import modes_along
from counterflex.files.tool_tip import read_modal, read_response

HEAD = "direction,frequency_hz,real_um_per_n,imaginary_um_per_n"
MODAL = "direction,frequency_hz,damping_ratio,stiffness_n_per_um"
TOOL = modes_along(np.array([900.0]), np.array([0.03]), np.array([2e7]), np.array([[0.0, 1.0, 0.0]]))


def _rows(direction: str = "y", first: int = 200, count: int = 40) -> list[str]:
    f = np.arange(first, first + 40 * count, 40.0)
    g = TOOL.response(2.0 * np.pi * f)[:, 1, 1] * 1e6
    return [f"{direction},{a:g},{b.real!r},{b.imag!r}" for a, b in zip(f, g.tolist(), strict=True)]


def _written(folder: Path, head: str, rows: list[str]) -> Path:
    file = folder / "tip.csv"
    file.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    return file


def test_response_is_read(tmp_path: Path) -> None:
    read = read_response(_written(tmp_path, HEAD, _rows()))
    np.testing.assert_allclose(read.receptance, TOOL.response(read.omega_rad_s), atol=1e-14)


def test_modal_parameters_are_read(tmp_path: Path) -> None:
    modes = read_modal(_written(tmp_path, MODAL, ["y,900,0.03,20"]))
    np.testing.assert_allclose(modes.shape, TOOL.shape)
    np.testing.assert_allclose(modes.omega_rad_s, TOOL.omega_rad_s)


@pytest.mark.parametrize(
    ("head", "rows", "says"),
    [
        (HEAD.replace("real_um_per_n", "real"), _rows(), "no column real_um_per_n"),
        (HEAD, _rows("w"), "unknown direction"),
        (HEAD, [*_rows(), *_rows("x", 210)], "direction y has other frequencies"),
        (HEAD, _rows()[::-1], "do not rise"),
        (HEAD, _rows()[:3], "too few points"),
        (HEAD, [row.replace(",-", ",") for row in _rows()], "imaginary part is positive"),
        (HEAD, [*_rows()[:20], "y,1000,abc,0"], "not a number"),
        (HEAD, [*_rows()[:20], "y,1000,,0"], "has no value"),
        (HEAD, [*_rows()[:20], "y,1000,5e3,0"], "receptance is out of range"),
        (HEAD, ["y,0,1,1"], "frequency_hz is out of range"),
        (HEAD, [], "no rows"),
    ],
)
def test_bad_response(tmp_path: Path, head: str, rows: list[str], says: str) -> None:
    with pytest.raises(FileFormatError) as fault:
        read_response(_written(tmp_path, head, rows))
    assert says in str(fault.value)
    assert "tip.csv" in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("row", "says"),
    [("y,900,3,20", "damping_ratio"), ("y,900,0.03,0", "stiffness_n_per_um"), ("y,1e9,0.03,20", "frequency_hz")],
)
def test_bad_modal_parameters(tmp_path: Path, row: str, says: str) -> None:
    with pytest.raises(FileFormatError, match=f"{says} is out of range"):
        read_modal(_written(tmp_path, MODAL, [row]))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        read_modal(tmp_path / "none.csv")
