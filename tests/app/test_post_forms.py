"""Programs in the form that common posts write: read as the path they are, written back byte for byte, planned."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from counterflex.app.compensation.compensate import compensate
from counterflex.app.inputs import read_job
from counterflex.core.errors import ProgramError
from counterflex.core.units import MM, RPM, UM
from counterflex.files.cell.cell import Cell, resolve
from counterflex.files.cell.tables import CellTables
from counterflex.files.schema import parse
from counterflex.path.toolpath import FEED

ROOT = Path(__file__).resolve().parents[2]
POSTS = ROOT / "tests" / "data" / "posts"
CELL = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
ARC_ENDS_AT_BEND = {
    "catia.aptsource", "nx.cls", "robodk_fanuc.ls", "robodk_krc4.src", "robotstudio.mod", "spline.src",
    "fusion_840d.mpf", "fusion_fanuc.nc", "mastercam.nc",
}  # fmt: skip
STRAIGHT = {"kss_inline.src", "kss83_inline.src", "powermill.src"}
ROBOTS = (".src", ".mod", ".ls")


def cell(**tool: Any) -> Cell:
    data = tomllib.loads(CELL.read_text(encoding="utf-8"))
    given = {"tool_data": 1, "tooldata": "tMill", "spindle_rpm": 13000.0} | tool
    data["tools"][0] |= {key: value for key, value in given.items() if value is not None}
    data["part"]["stock"]["cell_mm"] = 1.0
    return resolve(parse(CellTables, data, where="test"), CELL)


@pytest.mark.by_turn
@pytest.mark.parametrize("name", sorted(ARC_ENDS_AT_BEND | STRAIGHT))
def test_the_path_is_that_of_the_groove(name: str) -> None:
    job = read_job(POSTS / name, cell())
    cut = (job.path.kind == FEED) & (np.abs(job.path.p_part_tcp[:, 2] / MM - 34.0) < 1e-6)
    p = job.path.p_part_tcp[cut] / MM
    on_first = np.abs(p[:, 1] - 15.0) < 1e-4
    assert p[on_first, 0].max() == pytest.approx(72.0 if name in STRAIGHT else 40.0, abs=1e-3)
    if name in ARC_ENDS_AT_BEND:
        bend = p[(p[:, 0] > 40.01) & (p[:, 1] < 19.99)]
        assert np.hypot(bend[:, 0] - 40.0, bend[:, 1] - 20.0) == pytest.approx(np.full(len(bend), 5.0), abs=2e-3)
    assert job.path.feed_m_s[cut].max() <= 0.05 + 1e-9
    assert job.path.spindle_rad_s[cut] == pytest.approx(np.full(cut.sum(), 13000.0 * RPM))


@pytest.mark.by_turn
@pytest.mark.parametrize("name", sorted(path.name for path in POSTS.iterdir() if path.suffix in ROBOTS))
def test_a_robot_whose_spindle_is_started_by_hand_is_planned(name: str) -> None:
    """With the speed of the cell file; without it, refused at the first cut with what to do."""
    made = compensate(POSTS / name, cell(), predict=False)
    assert np.linalg.norm(made.plan.correction_part[made.plan.cutting], axis=1).max() > 100.0 * UM
    source = (POSTS / name).read_text(encoding="utf-8")
    after = made.files[name]
    assert len(after.splitlines()) > len(source.splitlines())
    assert source.splitlines()[0] == after.splitlines()[0]
    with pytest.raises(ProgramError, match=r"spindle stopped.*spindle_rpm in \[\[tools\]\]"):
        compensate(POSTS / name, cell(spindle_rpm=None), predict=False)
