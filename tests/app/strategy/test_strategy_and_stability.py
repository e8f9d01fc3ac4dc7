"""One cell, one program: ``plan strategy`` and ``plan stability`` say the same of chatter."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from counterflex.app.stability import judge, structure_of
from counterflex.app.strategy.advice import WallOperation, advise
from counterflex.files.cell.cell import read_cell
from counterflex.plan.strategy.advise import CHATTER

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SIDE = """G17 G54 G40 G49 G80 G90
G21
M6 T1
G43 H1
M3 S6000
G0 Z60
G0 X-12 Y0
G0 Z42
G1 Z37 F3000
G1 X72 F900
G0 Z60
M5
M30
"""
STEEL = """[material]
name = "linear test steel"
law = "linear_edge"
ktc_n_mm2 = 1800
krc_n_mm2 = 540
kac_n_mm2 = 200
kte_n_mm = 10
kre_n_mm = 10
kae_n_mm = 1
chip_min_um = 1
chip_max_um = 300

"""


@pytest.mark.long
def test_half_immersion_in_steel_is_stable_for_both(tmp_path: Path) -> None:
    text = (EXAMPLES / "cells" / "kr300_d16_small.toml").read_text(encoding="utf-8")
    text = re.sub(r"^\[material\].*?(?=^\[)", lambda _: STEEL, text, flags=re.DOTALL | re.MULTILINE)
    (tmp_path / "steel.toml").write_text(text, encoding="utf-8")
    (tmp_path / "side.ngc").write_text(SIDE, encoding="utf-8")
    cell = read_cell(tmp_path / "steel.toml")
    summary = judge(tmp_path / "side.ngc", cell, structure_of(cell, None, None, None)).summary
    assert summary["verdict"] == "stable"
    assert summary["verdict_over_interval"] == "open"
    assert summary["worst"]["margin"] == pytest.approx(1.55, abs=0.06)
    before = advise(cell, WallOperation(), tmp_path / "side.ngc").before
    assert before is not None
    assert CHATTER not in before.violated(0)
    assert float(before.use[CHATTER][0]) == pytest.approx(1.0 / summary["worst"]["margin"], rel=0.02)
