"""Error of the path that a part showed (``counterflex-path-error``, version 1): one row per path point, Parquet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from counterflex.core.units import UM
from counterflex.evaluate.path_error.learning import MeasuredError
from counterflex.files.parquet_table import Column, columns, read, write

KIND: Final = "counterflex-path-error"
VERSION: Final = 1

LAYOUT: Final = (
    *columns("taken_x_um taken_y_um taken_z_um", "taken_m", UM),
    *columns("error_x_um error_y_um error_z_um", "error_m", UM),
    *columns("sigma_x_um sigma_y_um sigma_z_um", "sigma_m", UM),
    *(Column(f"seen_{axis}", "seen", i, whole=True) for i, axis in enumerate("xyz")),
)


def write_path_error(path: Path, error: MeasuredError, about: Mapping[str, Any]) -> None:
    """Write the error of a path, whole or not at all."""
    write(path, KIND, VERSION, LAYOUT, error, about)


def read_path_error(path: Path) -> tuple[MeasuredError, dict[str, Any]]:
    """Read the error of a path and its metadata."""
    data, about = read(path, KIND, VERSION, LAYOUT)
    data["seen"] = data["seen"] != 0
    return MeasuredError(**data), about
