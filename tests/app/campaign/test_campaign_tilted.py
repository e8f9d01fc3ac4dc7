"""A campaign of a program with a tilted tool: the same figures as prove, which plans and machines it on its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import polars
import pytest

from counterflex.app.campaign import campaign
from counterflex.app.campaign.axes import Grid
from counterflex.app.proof.prove import prove
from counterflex.app.proof.truth import truth_of
from counterflex.twin.truth.file import read_truth, write_truth
from counterflex.twin.truth.truth import Truth

CELL = Path(__file__).parents[3] / "examples" / "cells" / "kr300_bc_table.toml"
SHORT = (
    "G17 G54 G40 G49 G80 G90\nG21\nM6 T1\nM3 S13000\nG0 B15 C0\nG43.4 H1\nG0 X20 Y-12 Z60\nG0 Z42\nG1 Z36 F3000\n"
    "G1 Y12 F1500\nG0 Z60\nM5\nM30\n"
)


@pytest.mark.long
def test_tilted_cut_as_prove_has_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both machine the truth of a file: it differs in the last digit, and motion makes a micrometre of that."""

    def as_in_the_file(*args: Any) -> Truth:
        write_truth(tmp_path / "truth.toml", truth_of(*args))
        return read_truth(tmp_path / "truth.toml")

    monkeypatch.setattr("counterflex.app.proof.prove.truth_of", as_in_the_file)
    program = tmp_path / "tilted.ngc"
    program.write_text(SHORT, encoding="ascii")
    out = tmp_path / "out"
    campaign.run(CELL, out, grid=Grid([program]), seeds=[3], recipes=[], with_exact=True, workers=1)
    rows = polars.read_parquet(out / "results.parquet")
    proof = prove(program, CELL, tmp_path / "scratch", seeds=[3], workers=1).summary["seeds"]
    proved = {entry["truth_level"]: entry["variants"]["compensated"]["path"]["p997_mm"] for entry in proof}
    found = dict(rows.select("truth_level", "compensated_p997_mm").iter_rows())
    assert set(found) == {"catalogue", "exact"}
    assert found["catalogue"] == pytest.approx(proved["catalogue"], rel=1e-9)
    assert found["exact"] == pytest.approx(proved["exact"], abs=1e-4)
