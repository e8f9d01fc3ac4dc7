"""The net over random cubes of material: closed, two triangles at every edge, the volume of what it encloses."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from counterflex.core.arrays import Bool, Float
from counterflex.cutting.tridexel.surface import CrossedEdges, net


def _crossed(filled: Bool) -> tuple[list[CrossedEdges], Float]:
    """Edges between nodes of which one is filled, and the points in their middles."""
    crossed, points = [], []
    for along in range(3):
        edge = np.argwhere(np.diff(filled.astype(np.int64), axis=2 - along) != 0)
        middle = edge[:, ::-1].astype(np.float64)
        middle[:, along] += 0.5
        crossed.append(CrossedEdges(along, edge, filled[tuple(edge.T)]))
        points.append(middle)
    return crossed, np.concatenate(points)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.8])
def test_material_at_random_nodes_is_closed(share: float) -> None:
    filled = np.zeros((12, 13, 14), np.bool_)
    filled[1:-1, 1:-1, 1:-1] = np.random.default_rng(7).random((10, 11, 12)) < share
    crossed, points = _crossed(filled)
    vertices, triangles, around = net((11, 12, 13), crossed, points)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0
    assert around.shape == (len(points), 4)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert np.all(np.unique(sides, axis=0, return_counts=True)[1] == 2)


def test_a_block_has_its_volume_and_two_that_touch_stay_apart() -> None:
    filled = np.zeros((8, 8, 8), np.bool_)
    filled[1:4, 1:4, 1:4] = True
    one = trimesh.Trimesh(*net((7, 7, 7), *_crossed(filled))[:2], process=False)
    assert 18.0 < one.volume < 27.0  # three nodes a side, edges and corners cut off
    filled[4:7, 4:7, 1:4] = True  # meets the first along an edge only
    both = trimesh.Trimesh(*net((7, 7, 7), *_crossed(filled))[:2], process=False)
    assert both.is_watertight
    assert both.body_count == 2
    assert both.volume == pytest.approx(2.0 * one.volume, rel=1e-12)
