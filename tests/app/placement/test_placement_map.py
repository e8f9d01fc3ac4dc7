"""Maps over the working space: the present place by other means, places out of reach, pictures of it, bad input."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import polars as pl
import pytest

from counterflex.app import cell_modes
from counterflex.app.placement import placement_map
from counterflex.app.placement.placement_map import map_figure
from counterflex.app.placement.region import Wish
from counterflex.core.errors import InputError

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CELL, GROOVE = EXAMPLES / "cells" / "kr300_d16_small.toml", EXAMPLES / "programs" / "groove.ngc"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("map") / "out"
    placement_map.run(GROOVE, CELL, folder, points=3)
    return folder


def _summary(out: Path) -> dict[str, Any]:
    return dict(json.loads((out / "summary.json").read_text()))


def test_the_present_place_stands_in_the_middle_of_a_map_of_its_own(out: Path, tmp_path: Path) -> None:
    """A map of three places whose middle is the present one has the same figures there."""
    here = _summary(out)["present"]
    box = [limit for key in ("x_mm", "y_mm", "z_mm") for limit in (here[key] - 1.0, here[key] + 1.0)]
    placement_map.run(GROOVE, CELL, tmp_path / "own", points=3, wish=Wish(tuple(box)))
    rows = list(csv.DictReader((tmp_path / "own" / placement_map.TABLE).read_text().splitlines()))
    for middle in (rows[4], rows[13]):
        for key in placement_map.FIGURES:
            assert float(middle[key]) == pytest.approx(here[key], rel=2e-3), key


def test_a_place_out_of_reach_has_a_reason_and_no_figures(out: Path) -> None:
    rows = list(csv.DictReader((out / placement_map.TABLE).read_text().splitlines()))
    refused = [row for row in rows if row["refused"]]
    assert len(rows) == _summary(out)["places"] == 18
    assert 0 < len(refused) == _summary(out)["refused"] < 18
    assert all(row[key] == "" for row in refused for key in placement_map.FIGURES)
    assert all(float(row[key]) > 0.0 for row in rows if not row["refused"] for key in placement_map.FIGURES)


def test_the_first_frequency_is_that_of_the_modes_command(out: Path, tmp_path: Path) -> None:
    """Both know the same robot: two postures within a map differ less than a tenth from `modes` in the present one."""
    cell_modes.run(CELL, tmp_path / "modes")
    lowest = json.loads((tmp_path / "modes" / "summary.json").read_text())["modes"][0]["hz"]
    assert _summary(out)["present"]["first_mode_hz"] == pytest.approx(lowest, rel=0.1)


def test_the_pictures_are_valid_and_leave_refused_places_empty(out: Path) -> None:
    rows = pl.read_csv(out / placement_map.TABLE).to_dicts()
    figure = map_figure(rows, _summary(out)["present"], "level", "deflection_um")
    go.Figure(figure)
    level = [row for row in rows if row["view"] == "level"]
    z = np.array(figure["data"][0]["z"], dtype=np.float64)
    assert int(np.isnan(z).sum()) == sum(bool(row["refused"]) for row in level)
    assert "Working space" in (out / "report.html").read_text()


def test_an_empty_region_is_refused_and_nothing_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="empty along x"):
        placement_map.run(GROOVE, CELL, tmp_path / "out", wish=Wish((1000.0, 900.0, 0.0, 100.0, 0.0, 100.0)))
    assert not (tmp_path / "out").exists()


def test_three_files_are_written(out: Path) -> None:
    assert sorted(path.name for path in out.iterdir()) == ["map.csv", "report.html", "summary.json"]
