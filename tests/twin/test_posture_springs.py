"""Springs of the simulated cell that are other in other postures: statics against a plain cell, files, seeds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import CounterflexError, ModelError
from counterflex.robot.model.description import ElasticRegion
from counterflex.twin.plant.plant import Plant
from counterflex.twin.plant.slow_move import move
from counterflex.twin.truth.file import from_dict, read_truth, to_dict, write_truth
from counterflex.twin.truth.perturb import perturbed
from counterflex.twin.truth.truth import Truth


def changing(truth: Truth) -> Truth:
    free = next(b.name for b in truth.bodies if b.joint is None and b.compliance[4] > 0.0)
    return replace(
        truth,
        regions=(
            ElasticRegion("axis2", 5, 1, (-3.0, 3.0), (0.5, 2.0)),
            ElasticRegion(free, 4, 2, (-3.0, 0.0, 3.0), (2.0, 1.0, 0.5)),
        ),
    )


def still(truth: Truth, q: Float) -> Truth:
    """The same cell with the compliances of one posture."""
    bodies = []
    for body in truth.bodies:
        soft = np.array(body.compliance)
        for region in truth.regions:
            if region.segment == body.name:
                soft[region.direction] *= np.interp(q[region.axis], region.angles_rad, region.factors)
        bodies.append(replace(body, compliance=soft))
    return replace(truth, bodies=tuple(bodies), regions=())


def test_each_posture_has_the_springs_of_its_angles(truth: Truth, poses_rad: Float) -> None:
    """At rest and after a motion from elsewhere."""
    cell = changing(truth)
    plant = Plant(cell, friction=False)
    w = np.array([300.0, -200.0, -500.0, 0.0, 0.0, 0.0])
    for q in poses_rad[:3]:
        np.testing.assert_allclose(
            plant.equilibrium(q, w), Plant(still(cell, q), friction=False).equilibrium(q, w), atol=1e-9
        )
    q = poses_rad[0]
    plant.reset(q + np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0]), w)
    move(plant, q, w, move_s=1.5, rest_s=2.0)
    np.testing.assert_allclose(plant.tcp_pose()[:3, 3], plant.equilibrium(q, w)[:3, 3], atol=5e-6)


def test_files_keep_regions_and_seeds_put_them_off(truth: Truth, tmp_path: Path) -> None:
    cell = changing(truth)
    write_truth(tmp_path / "t.toml", cell)
    again = read_truth(tmp_path / "t.toml").regions
    for a, b in zip(again, cell.regions, strict=True):
        assert (a.segment, a.direction, a.axis) == (b.segment, b.direction, b.axis)
        np.testing.assert_allclose((a.angles_rad, a.factors), (b.angles_rad, b.factors))
    one, same, two = (perturbed(cell, seed).regions[0].factors for seed in (1, 1, 2))
    assert one == same != two
    assert all(0.2 < f < 4.0 for f in (*one, *two))


@pytest.mark.parametrize(
    ("key", "value"),
    [("body", "axis9"), ("direction", "xx"), ("axis", 7), ("axis", 0), ("angles_deg", [3, 1]), ("factors", [0, 1])],
)
def test_impossible_regions_are_refused(truth: Truth, key: str, value: object) -> None:
    data = to_dict(changing(truth))
    data["elastic_regions"][0][key] = value
    with pytest.raises(CounterflexError):
        from_dict(data)


def test_a_rigid_coordinate_has_no_region(truth: Truth) -> None:
    with pytest.raises(ModelError, match="no such spring"):
        replace(truth, regions=(ElasticRegion("axis2", 0, 1, (0.0, 1.0), (1.0, 2.0)),))
