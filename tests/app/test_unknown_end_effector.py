"""A spindle whose stiffness nobody states is not silently rigid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.app.cut_points import corner_points
from counterflex.app.unknown_stiffness import unknown_stiffness
from counterflex.app.unknowns import DisplacementSource, sources
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.compliance import shares
from counterflex.robot.model import class_prior

FILE = Path(__file__).parents[2] / "examples" / "cells" / "kr300_d16_small.toml"
STATED = "rx_urad_per_knm = 5263.0\nry_urad_per_knm = 14925.0\nrz_urad_per_knm = 10989.0\n"


def cell(tmp_path: Path, compliance: str) -> Cell:
    """The example cell with another compliance of its spindle."""
    text = FILE.read_text()
    assert STATED in text
    file = tmp_path / "cell.toml"
    file.write_text(text.replace(STATED, compliance))
    return read_cell(file)


def of_end_effector(one: Cell) -> list[DisplacementSource]:
    return [source for source in sources(one, corner_points(one)) if "end effector (" in source.name]


def test_a_spindle_without_compliance_is_ranked_and_said(tmp_path: Path) -> None:
    unknown = cell(tmp_path, "")
    (source,) = of_end_effector(unknown)
    assert "spindle" in source.name
    assert any("no stiffness is known of spindle" in text for text in unknown_stiffness(unknown))


@pytest.mark.parametrize("stated", [STATED, "rz_urad_per_knm = 0\n"])
def test_a_stated_one_is_neither_though_it_is_rigid(tmp_path: Path, stated: str) -> None:
    known = cell(tmp_path, stated)
    assert of_end_effector(known) == []
    assert unknown_stiffness(known) == []


def test_the_spring_yields_as_that_of_the_chain(tmp_path: Path) -> None:
    """Judged by the elastic chain with a body of that compliance about three axes."""
    unknown = cell(tmp_path, "")
    points = corner_points(unknown)
    (source,) = of_end_effector(unknown)
    assert source.displacements is not None
    body = unknown.chain.names.index("spindle")
    k = class_prior.drawn(1000, 1004)
    compliance = np.array(unknown.chain.compliance)
    compliance[body] = [0.0, 0.0, 0.0, *[1.0 / k[0]] * 3]
    chain: ElasticChain = replace(unknown.chain, compliance=compliance)
    expected = shares(chain, points.q, points.w_tcp_base)[:, body, :3]
    np.testing.assert_allclose(source.displacements[0], expected, atol=1e-12)


def test_the_prior_holds_what_is_published() -> None:
    low, high = np.quantile(class_prior.drawn(20_000, 1), [0.05, 0.95])
    for published in (1.9e5, 6.7e4, 9.1e4, 0.25**2 / 0.131e-6):
        assert low < published < high
