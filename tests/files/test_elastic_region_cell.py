"""``[[robot.elastic_region]]``: what is written is what a chain has, and what makes no sense is named."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from counterflex.core.errors import CounterflexError
from counterflex.core.units import DEG
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.measured import IdentifiedTable
from counterflex.files.cell.update import check_update, updated_text
from counterflex.identify.data.changes import Change, ElementCompliance, ElementRegion
from counterflex.robot.model.description import ComplianceCurve, ElasticRegion

CELL = Path(__file__).resolve().parents[1] / "data" / "cells" / "small.toml"
ROW = {
    "segment": "axis2",
    "direction": "rz",
    "axis": 2,
    "angles_deg": [-110, -85, -65, -40],
    "factors": [0.7, 0.7, 1.3, 1.3],
}
ENTRY = IdentifiedTable(recipe="stiffness", date="now", data=(), data_sha256=(), counterflex="0", holdout="")


def cell(folder: Path, *rows: Mapping[str, Any], key: str = "elastic_region") -> Cell:
    data = tomllib.loads(CELL.read_text())
    data["robot"][key] = list(rows)
    file = folder / "cell.toml"
    file.write_text(tomli_w.dumps(data))
    return read_cell(file)


def test_the_chain_has_it_in_si(tmp_path: Path) -> None:
    found = cell(tmp_path, ROW)
    region = ElasticRegion("axis2", 5, 1, tuple(a * DEG for a in (-110, -85, -65, -40)), (0.7, 0.7, 1.3, 1.3))
    assert found.chain.regions == found.controller_chain.regions == (region,)
    plain = read_cell(CELL).chain
    q = np.zeros(6)
    q[1] = -75 * DEG
    np.testing.assert_allclose(found.chain.compliance_at(q), plain.compliance, rtol=1e-12)
    q[1] = -100 * DEG
    i = plain.names.index("axis2")
    assert found.chain.compliance_at(q)[i, 5] == pytest.approx(0.7 * plain.compliance[i, 5])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"segment": "axs2"}, "axs2"),
        ({"direction": "ty"}, "rigid"),
        ({"direction": "z"}, "direction"),
        ({"axis": 7}, "axis"),
        ({"factors": [0.7, 1.3]}, "one factor for every angle"),
        ({"angles_deg": [-110, -85, -85, -40]}, "do not rise"),
        ({"factors": [0.7, 0.7, 1.3, 20]}, "factors"),
        ({"angles_deg": [-110], "factors": [1.2]}, "angles_deg"),
    ],
)
def test_what_makes_no_sense_is_named(tmp_path: Path, change: Mapping[str, Any], said: str) -> None:
    with pytest.raises(CounterflexError, match=said) as fault:
        cell(tmp_path, {**ROW, **change})
    assert "\n" not in str(fault.value)
    assert "cell.toml" in str(fault.value)


def written(found: Cell, changes: list[Change], folder: Path) -> Cell:
    return check_update(updated_text(found, changes, ENTRY, folder), folder / "new.toml")


def test_what_is_identified_is_read_back_and_multiplies_what_was_known(tmp_path: Path) -> None:
    more = ElasticRegion("axis2", 5, 2, (1.0, 2.0), (1.2, 0.8))
    for rows in ((), (ROW,)):
        before = cell(tmp_path, *rows)
        after = written(before, [ElementRegion(more)], tmp_path).chain
        assert len(after.regions) == len(rows) + 1
        q = np.array([0.0, -1.9, 1.3, 0.0, 0.5, 0.0])
        both = before.chain.compliance_at(q) * replace(before.chain, regions=(more,)).compliance_at(q)
        np.testing.assert_allclose(after.compliance_at(q) * before.chain.compliance, both, rtol=1e-8, atol=1e-30)


def test_curves_are_read_written_and_replaced(tmp_path: Path) -> None:
    row = {"segment": "axis2", "direction": "rz", "loads_nm": [-900, 0, 900], "factors": [0.8, 1.4, 0.8]}
    before = cell(tmp_path, row, key="compliance_curve")
    curve = ComplianceCurve("axis2", 5, (-900.0, 0.0, 900.0), (0.8, 1.4, 0.8))
    assert before.chain.curves == before.controller_chain.curves == (curve,)
    new = ComplianceCurve("axis2", 5, (-100.0, 500.0), (0.5, 1.5))
    assert written(before, [ElementRegion(new)], tmp_path).chain.curves == (new,)
    assert written(before, [ElementCompliance("axis2", np.zeros(6))], tmp_path).chain.curves == ()
    for change, said in (
        ({"loads_n": [0, 1], "loads_nm": None}, "loads_nm"),
        ({"loads_nm": [0, 1]}, "one factor for every load"),
        ({"loads_nm": [0, 1, 1]}, "do not rise"),
        ({"segment": "axs2"}, "axs2"),
        ({"direction": "ty"}, "loads_n"),
    ):
        with pytest.raises(CounterflexError, match=said) as fault:
            cell(tmp_path, {k: v for k, v in (row | change).items() if v is not None}, key="compliance_curve")
        assert "\n" not in str(fault.value)


def test_a_spring_that_was_found_rigid_loses_its_regions(tmp_path: Path) -> None:
    before = cell(tmp_path, ROW, {**ROW, "segment": "axis3"})
    after = written(before, [ElementCompliance("axis2", np.zeros(6))], tmp_path)
    assert [r.segment for r in after.chain.regions] == ["axis3"]
