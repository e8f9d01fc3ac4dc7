"""`compensate` writes the feed that spindle, tool and robot bear, and names the limit that binds."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from counterflex.app.compensation.compensate import run
from counterflex.core.errors import FileFormatError
from counterflex.files.cell.cell import read_cell
from counterflex.files.schema import write_toml

CELL = Path(__file__).parents[2] / "data" / "cells" / "small.toml"
TEXT = "G21 G17 G90 G94\nM6 T1\nM3 S13000\nG0 Z60\nG0 X-12 Y15\nG0 Z42\nG1 Z36 F3000\nG1 X52 F1500\nG0 Z60\nM30\n"


def cell(folder: Path, **limits: Any) -> Path:
    data = tomllib.loads(CELL.read_text(encoding="utf-8"))
    data["dynamics"] = {"swing_um": 0.0}
    if limits:
        data["process_limits"] = limits
    write_toml(folder / "cell.toml", data)
    return folder / "cell.toml"


def compensated(folder: Path, **limits: Any) -> tuple[dict[str, Any], list[float]]:
    (folder / "slot.ngc").write_text(TEXT, encoding="utf-8")
    summary = run(folder / "slot.ngc", cell(folder, **limits), folder / "out", report=False, predict=False)
    text = (folder / "out" / "slot.ngc").read_text(encoding="utf-8")
    return summary, [float(feed) for feed in re.findall(r"F([0-9.]+)", text)]


def test_the_feed_is_lowered_where_the_spindle_is_too_weak(tmp_path: Path) -> None:
    free, feeds = compensated(tmp_path)
    assert "feed_limits" not in free
    assert min(feeds) > 1400.0  # a corrected path is a little longer or shorter
    bound, slower = compensated(tmp_path, spindle_power_w=2400.0, spindle_torque_nm=100.0)
    (line,) = bound["feed_limits"]["lines"]
    assert line["limit"] == "spindle power"
    assert line["line"] == 8
    assert line["kept"]
    assert line["before_percent"] > 100.0 >= line["after_percent"] - 0.1
    assert min(slower) == pytest.approx(15.0 * line["feed_percent"], rel=0.05)
    assert bound["feed_limits"]["extra_s"] > 0.0
    assert bound["calm_feed"]["lines"] == []
    assert bound["prediction"]["peak_force_n"]["value"] < free["prediction"]["peak_force_n"]["value"]


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"spindle_min_rpm": 9000, "spindle_max_rpm": 8000}, "spindle_min_rpm = 9000 is not below"),
        ({"spindle_power_w": 0}, "spindle_power_w"),
        ({"axis_torque_nm": [100, 100]}, "axis_torque_nm"),
        ({"spindle_power_kw": 8}, "spindle_power_kw"),
    ],
)
def test_bad_limits_are_one_line(limits: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=said) as fault:
        read_cell(cell(tmp_path, **limits))
    assert "process_limits" in str(fault.value)
    assert "\n" not in str(fault.value)
