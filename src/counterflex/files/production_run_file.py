"""What one run gave production identification (``counterflex-production-run``, version 1): its steady stretches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from counterflex.core.units import DEG, MM, UM
from counterflex.files.parquet_table import Column, columns, read, write
from counterflex.identify.production.planned import EXPONENTS
from counterflex.identify.production.stretches import Stretches

KIND: Final = "counterflex-production-run"
VERSION: Final = 1
_AXES: Final = ("along", "left", "up")
_MAPS: Final = " ".join(f"force_{a}_by_{c}{round(100 * p):03d}_mm" for a in _AXES for c in "cra" for p in EXPONENTS)
_SHAPES: Final = {"maps_m": (3, 3, len(EXPONENTS)), "axes": (3, 3)}

LAYOUT: Final = (
    Column("row", "row", whole=True),
    Column("contact", "cut", whole=True),
    *columns("force_along_n force_left_n force_up_n", "force"),
    *columns("sigma_along_n sigma_left_n sigma_up_n", "sigma"),
    Column("axial_depth_mm", "depth_m", unit=MM),
    Column("entry_deg", "entry_rad", unit=DEG),
    Column("exit_deg", "exit_rad", unit=DEG),
    Column("feed_per_tooth_um", "feed_tooth_m", unit=UM),
    *columns("give_along_um give_left_um give_up_um", "give_m", UM),
    *columns("sent_along_um sent_left_um sent_up_um", "sent_m", UM),
    Column("top_mm", "top_m", unit=MM),
    Column("cut_mm", "run_m", unit=MM),
    Column("grid_mm", "grid_m", unit=MM),
    *columns(" ".join(f"{a}_{b}" for a in _AXES for b in "xyz"), "axes"),
    *columns("by_depth_along_n_mm by_depth_left_n_mm by_depth_up_n_mm", "by_depth", 1.0 / MM),
    *columns("by_left_along_n_mm by_left_left_n_mm by_left_up_n_mm", "by_left", 1.0 / MM),
    *columns("by_right_along_n_mm by_right_left_n_mm by_right_up_n_mm", "by_right", 1.0 / MM),
    *columns(_MAPS, "maps_m", MM),
)


def write_production_run(path: Path, stretches: Stretches, about: Mapping[str, Any]) -> None:
    """Write the stretches of a run; ``about`` says of which run, plan, tool and material they are."""
    values = {f.name: getattr(stretches, f.name) for f in fields(Stretches)}
    flat = {name: values[name].reshape(len(stretches), -1) for name in _SHAPES}
    write(path, KIND, VERSION, LAYOUT, SimpleNamespace(**{**values, **flat}), about)


def read_production_run(path: Path) -> tuple[Stretches, dict[str, Any]]:
    """Read them back, with what is said about them."""
    data, about = read(path, KIND, VERSION, LAYOUT)
    for name, shape in _SHAPES.items():
        data[name] = np.ascontiguousarray(data[name].reshape(-1, *shape))
    return Stretches(**data), about
